//! Metrics for Prometheus, in its text format.

use prometheus_client::encoding::{EncodeMetric, MetricEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::{ConstCounter, Counter};
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::{Registry, Unit};

use crate::control::Run;
use crate::pilot::{LinkState, Reactions, Status};
use crate::robot::AgentEvent;

/// The one label of a family: its name and its value.
type Label = [(&'static str, &'static str); 1];

/// The pilot's reaction times as a histogram.
#[derive(Debug)]
struct FrameToMove(Reactions);

impl EncodeMetric for FrameToMove {
    fn encode(&self, mut encoder: MetricEncoder<'_>) -> Result<(), std::fmt::Error> {
        let tally = self.0.tally();
        encoder.encode_histogram::<NoLabelSet>(tally.sum, tally.count, &tally.buckets, None)
    }

    fn metric_type(&self) -> MetricType {
        MetricType::Histogram
    }
}

/// What is counted; everything else is read when it is asked for.
#[derive(Default)]
pub(super) struct Metrics {
    links: Counter,
    losses: Counter,
    acts: Family<Label, Counter>,
    docks: Family<Label, Counter>,
    starts: Counter,
    ends: Family<Label, Counter>,
}

fn count(family: &Family<Label, Counter>, label: &'static str, value: &'static str) {
    family.get_or_create(&[(label, value)]).inc();
}

impl Metrics {
    pub(super) fn count(&self, what: &AgentEvent) {
        match what {
            AgentEvent::LinkUp { .. } => drop(self.links.inc()),
            AgentEvent::LinkDown { .. } => drop(self.losses.inc()),
            AgentEvent::Started { .. } => drop(self.starts.inc()),
            AgentEvent::Ended { reason, .. } => count(&self.ends, "reason", reason.name()),
            AgentEvent::Dock { end, .. } => count(&self.docks, "code", end.name()),
            AgentEvent::Safety { action, .. } => count(&self.acts, "action", action.name()),
            _ => {}
        }
    }

    pub(super) fn text(&self, run: &Run, viewers: usize, bytes: u64) -> String {
        let status = *run.status.borrow();
        let mut registry = Registry::with_prefix("spykee");
        registry.register_with_unit(
            "camera",
            "Bytes of all frames received",
            Unit::Bytes,
            ConstCounter::new(bytes),
        );
        registry.register_with_unit(
            "frame_to_move",
            "From the last byte of a frame to the first MOVE after it requested by a behaviour",
            Unit::Seconds,
            FrameToMove(run.reactions.clone()),
        );
        let viewers = ConstGauge::new(viewers as i64);
        registry.register("viewers", "Open pages", viewers);
        add_status(&mut registry, &status);
        let mut count =
            |name, help, counter: &Counter| registry.register(name, help, counter.clone());
        count("link_logins", "Logins at the robot", &self.links);
        count("link_losses", "Lost links", &self.losses);
        count(
            "behaviour_starts",
            "Starts and restarts of behaviours",
            &self.starts,
        );
        let mut by_kind = |name, help, family: &Family<Label, Counter>| {
            registry.register(name, help, family.clone());
        };
        by_kind(
            "safety_acts",
            "Actions of the watchdog, by kind",
            &self.acts,
        );
        by_kind("docks", "Dockings, by result", &self.docks);
        by_kind(
            "behaviour_ends",
            "Behaviours that ended, by reason",
            &self.ends,
        );
        let mut page = String::new();
        // Writing to a string cannot fail.
        let _ = text::encode(&mut page, &registry);
        page
    }
}

/// Adds what is known of the robot now.
fn add_status(registry: &mut Registry, status: &Status) {
    let battery = status.battery;
    let charging = battery.is_some_and(|battery| battery.charging);
    let up = status.link == LinkState::Up;
    let mut flag = |name, help, is_on: bool| {
        registry.register(name, help, ConstGauge::new(i64::from(is_on)));
    };
    flag(
        "battery_charging",
        "1 while the battery is charging",
        charging,
    );
    let low = "1 while the battery is low and the watchdog controls the robot";
    flag("battery_low", low, status.low);
    flag("docked", "1 on the station", status.docked);
    flag(
        "stopped_by_person",
        "1 while STOP holds",
        status.emergency_stop,
    );
    flag("link_up", "1 while the robot is connected", up);
    let frames = ConstCounter::new(status.frames);
    registry.register("camera_frames", "Frames received", frames);
    let percent = battery.and_then(|battery| battery.percent);
    let percent = percent.map_or(f64::NAN, |percent| f64::from(percent.get()));
    let help = "Level of the battery; NaN: unknown";
    registry.register("battery_percent", help, ConstGauge::new(percent));
    let minutes = battery.and_then(|battery| battery.minutes_left);
    let mut duration = |name, help, seconds: Option<f64>| {
        let gauge = ConstGauge::new(seconds.unwrap_or(f64::NAN));
        registry.register_with_unit(name, help, Unit::Seconds, gauge);
    };
    let left = minutes.map(|minutes| 60.0 * f64::from(minutes));
    let help = "Estimated time until the battery is empty; NaN: unknown";
    duration("battery_left", help, left);
    let robot = status.delays.map(|delays| delays.robot.as_secs_f64());
    let help = "From the arrival of a command at the robot to its execution; NaN: unknown";
    duration("robot_delay", help, robot);
    let network = status.delays.map(|delays| delays.network.as_secs_f64());
    let help = "Through the network to the robot and back; NaN: unknown";
    duration("network_delay", help, network);
}
