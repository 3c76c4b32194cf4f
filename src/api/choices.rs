//! Sets of names that arguments and results are taken from.

use super::model::Choice;
use crate::robot::{DockEnd, MotionEnd, SafetyAction};
use crate::vision::Colour;
use crate::wire::{Sound, Stream};

pub(super) const LIGHT: &Choice = &Choice {
    name: "Light",
    what: "light",
    names: || vec!["flash", "left", "right", "all"],
};

pub(super) const SOUND: &Choice = &Choice {
    name: "Sound",
    what: "sound",
    names: || Sound::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const STREAM: &Choice = &Choice {
    name: "Stream",
    what: "stream",
    names: || Stream::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const QUEUE: &Choice = &Choice {
    name: "Queue",
    what: "queue",
    names: || vec!["latest", "all"],
};

pub(super) const COLOUR_NAME: &Choice = &Choice {
    name: "ColourName",
    what: "colour",
    names: || Colour::NAMES.to_vec(),
};

pub(super) const MOTION_CODE: &Choice = &Choice {
    name: "MotionCode",
    what: "code",
    names: || MotionEnd::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const DOCK_CODE: &Choice = &Choice {
    name: "DockCode",
    what: "code",
    names: || DockEnd::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const SAFETY_ACTION: &Choice = &Choice {
    name: "SafetyAction",
    what: "action",
    names: || SafetyAction::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const TASK_STATUS: &Choice = &Choice {
    name: "TaskStatus",
    what: "status",
    names: || vec!["running", "done", "failed", "cancelled"],
};
