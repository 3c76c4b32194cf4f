//! Metrics for Prometheus, in its text format.

use prometheus_client::encoding::{EncodeMetric, MetricEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Metric, Registry, Unit};

use std::sync::atomic::AtomicU64;
use std::time::Duration;

use crate::control::Run;
use crate::link::Delays;
use crate::pilot::{LinkState, Reactions};
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

pub(super) struct Metrics {
    registry: Registry,
    percent: Gauge<f64, AtomicU64>,
    left: Gauge<f64, AtomicU64>,
    robot_delay: Gauge<f64, AtomicU64>,
    network_delay: Gauge<f64, AtomicU64>,
    charging: Gauge,
    low: Gauge,
    docked: Gauge,
    emergency_stop: Gauge,
    up: Gauge,
    viewers: Gauge,
    frames: Counter,
    bytes: Counter,
    links: Counter,
    losses: Counter,
    acts: Family<Label, Counter>,
    docks: Family<Label, Counter>,
    starts: Counter,
    ends: Family<Label, Counter>,
}

fn metric<M: Metric + Clone + Default>(registry: &mut Registry, name: &str, help: &str) -> M {
    let metric = M::default();
    registry.register(name, help, metric.clone());
    metric
}

fn count(family: &Family<Label, Counter>, label: &'static str, value: &'static str) {
    family.get_or_create(&[(label, value)]).inc();
}

fn seconds(registry: &mut Registry, name: &str, help: &str) -> Gauge<f64, AtomicU64> {
    let metric = Gauge::default();
    registry.register_with_unit(name, help, Unit::Seconds, metric.clone());
    metric
}

impl Metrics {
    pub(super) fn new(reactions: Reactions) -> Metrics {
        let mut registry = Registry::with_prefix("spykee");
        let one = &mut registry;
        let bytes = Counter::default();
        one.register_with_unit(
            "camera",
            "Bytes of all frames received",
            Unit::Bytes,
            bytes.clone(),
        );
        one.register_with_unit(
            "frame_to_move",
            "From the last byte of a frame to the first MOVE after it requested by a behaviour",
            Unit::Seconds,
            FrameToMove(reactions),
        );
        Metrics {
            bytes,
            percent: metric(one, "battery_percent", "Level of the battery; NaN: unknown"),
            left: seconds(
                one,
                "battery_left",
                "Estimated time until the battery is empty; NaN: unknown",
            ),
            robot_delay: seconds(
                one,
                "robot_delay",
                "From the arrival of a command at the robot to its execution; NaN: unknown",
            ),
            network_delay: seconds(
                one,
                "network_delay",
                "Through the network to the robot and back; NaN: unknown",
            ),
            charging: metric(one, "battery_charging", "1 while the battery is charging"),
            low: metric(
                one,
                "battery_low",
                "1 while the battery is low and the watchdog controls the robot",
            ),
            docked: metric(one, "docked", "1 on the station"),
            emergency_stop: metric(one, "stopped_by_person", "1 while STOP holds"),
            up: metric(one, "link_up", "1 while the robot is connected"),
            viewers: metric(one, "viewers", "Open pages"),
            frames: metric(one, "camera_frames", "Frames received"),
            links: metric(one, "link_logins", "Logins at the robot"),
            losses: metric(one, "link_losses", "Lost links"),
            acts: metric(one, "safety_acts", "Actions of the watchdog, by kind"),
            docks: metric(one, "docks", "Dockings, by result"),
            starts: metric(one, "behaviour_starts", "Starts and restarts of behaviours"),
            ends: metric(one, "behaviour_ends", "Behaviours that ended, by reason"),
            registry,
        }
    }

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
        let battery = status.battery;
        let percent = battery.and_then(|battery| battery.percent);
        self.percent
            .set(percent.map_or(f64::NAN, |percent| f64::from(percent.get())));
        let minutes = battery.and_then(|battery| battery.minutes_left);
        let seconds = minutes.map_or(f64::NAN, |minutes| 60.0 * f64::from(minutes));
        self.left.set(seconds);
        let delay = |of: fn(Delays) -> Duration| {
            status
                .delays
                .map_or(f64::NAN, |delays| of(delays).as_secs_f64())
        };
        self.robot_delay.set(delay(|delays| delays.robot));
        self.network_delay.set(delay(|delays| delays.network));
        self.charging
            .set(battery.is_some_and(|battery| battery.charging).into());
        self.low.set(status.low.into());
        self.docked.set(status.docked.into());
        self.emergency_stop.set(status.emergency_stop.into());
        self.up.set((status.link == LinkState::Up).into());
        self.viewers.set(viewers as i64);
        self.frames
            .inc_by(status.frames.saturating_sub(self.frames.get()));
        self.bytes.inc_by(bytes.saturating_sub(self.bytes.get()));
        let mut page = String::new();
        // Writing to a string cannot fail.
        let _ = text::encode(&mut page, &self.registry);
        page
    }
}
