//! What scripts can listen to.

use super::terms::Event;

const fn event(name: &'static str, doc: &'static str) -> Event {
    Event {
        name,
        payload: None,
        doc,
    }
}

impl Event {
    const fn with(self, payload: &'static str) -> Event {
        Event {
            payload: Some(payload),
            ..self
        }
    }
}

pub(super) const EVENTS: &[Event] = &[
    event("connected", "There is a link to the robot.").with("Connected"),
    event("disconnected", "The link is lost.").with("Disconnected"),
    event("battery", "The battery's level or charging changed.").with("Battery"),
    event(
        "battery_low",
        "The watchdog finds the battery low and takes the robot home.",
    )
    .with("Battery"),
    event("battery_ok", "The watchdog lets go of a robot that was low: it charges, or its battery is full enough.").with("Battery"),
    event("charging", "Charging began or ended.").with("Charging"),
    event("charged", "The battery is full."),
    event("docked", "The robot stands on its charging station."),
    event("undocked", "The robot has left its charging station."),
    event(
        "base_not_found",
        "The robot has not found its charging station.",
    ),
    event(
        "frame",
        "The camera has sent a picture; only the newest is kept.",
    )
    .with("Frame"),
    event(
        "audio",
        "The microphone has sent a chunk of sound; only the newest is kept.",
    )
    .with("Audio"),
    event("noise", "It became loud: a sound above the set level, after a second without one.").with("Noise"),
    event("sound_finished", "The robot has finished playing music."),
    event("safety", "The watchdog has done something.").with("Safety"),
    event(
        "loan",
        "The watchdog lends this behaviour the tracks of a robot with a low battery. Only the rescue behaviour of the config hears of it.",
    )
    .with("Loan"),
    event("engine", "The robot has sent a code that nobody knows.").with("Engine"),
];
