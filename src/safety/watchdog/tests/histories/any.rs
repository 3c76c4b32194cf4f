//! Random histories.

use super::*;

fn any_power() -> impl Strategy<Value = Power> {
    // Includes values above 100: the type allows them.
    let percent = prop_oneof![3 => 0..=100u8, 4 => 5..=25u8, 2 => 48..=52u8, 1 => any::<u8>()];
    (percent, prop::bool::weighted(0.25))
        .prop_map(|(percent, charging)| Power { percent, charging })
}

fn any_news() -> impl Strategy<Value = EngineReport> {
    let byte =
        prop_oneof![2 => Just(1), 2 => Just(2), 1 => Just(3), 4 => Just(8), 1 => any::<u8>()];
    byte.prop_map(|byte: u8| EngineReport::from(byte))
}

/// From zero to more than any clock can hold: a host may send any duration.
fn any_duration() -> impl Strategy<Value = Duration> {
    prop_oneof![
        1 => Just(Duration::ZERO),
        1 => Just(Duration::from_nanos(1)),
        1 => Just(Duration::MAX),
        4 => (1..3000u64).prop_map(Duration::from_millis),
        2 => (1..200u64).prop_map(Duration::from_secs),
    ]
}

fn any_intent() -> impl Strategy<Value = Intent> {
    let power = || prop_oneof![8 => -100.0..=100.0f64, 1 => Just(0.0), 1 => Just(-0.4)];
    let drive = (0..50u64, power(), power(), prop::option::of(any_duration()));
    let plan = (any_duration(), 0..3u32, any_duration());
    prop_oneof![
        8 => drive.prop_map(|(motion, left, right, duration)| Intent::Move {
            motion: MotionId(motion),
            setpoint: Setpoint::from_percent(left, right).unwrap(),
            duration,
        }),
        1 => (0..50u64).prop_map(|motion| Intent::Release { motion: MotionId(motion) }),
        1 => Just(Intent::Stop),
        3 => (0..50u64, plan).prop_map(|(call, (timeout, retries, charge_timeout))| {
            Intent::Dock { call: CallId(call), plan: DockPlan { timeout, retries, charge_timeout } }
        }),
        4 => (0..50u64, any_duration()).prop_map(|(call, timeout)| Intent::Undock { call: CallId(call), timeout }),
        1 => Just(Intent::CancelDock),
    ]
}

fn any_fact() -> impl Strategy<Value = Fact> {
    let who = || (0..3u16).prop_map(BehaviourId);
    let login = (prop::bool::weighted(0.2), any_power());
    prop_oneof![
        3 => login.prop_map(|(docked, power)| Fact::LinkUp { docked, power }),
        2 => Just(Fact::LinkDown),
        2 => any::<bool>().prop_map(Fact::Streaming),
        3 => Just(Fact::BytesReceived),
        10 => any_power().prop_map(Fact::Power),
        12 => any_news().prop_map(Fact::Engine),
        8 => who().prop_map(Fact::Alive),
        2 => who().prop_map(Fact::Gone),
        30 => (who(), any_intent()).prop_map(|(by, intent)| Fact::Asked {
            by,
            priority: Priority(by.0 as i16 / 2),
            intent,
        }),
        1 => Just(Fact::RunEnding),
        2 => Just(Fact::Suspended),
        4 => prop::option::weighted(0.9, who()).prop_map(Fact::Rescuer),
    ]
}

fn any_step() -> impl Strategy<Value = Step> {
    let jump = prop_oneof![3 => 0..400u64, 1 => 0..700_000u64].prop_map(Duration::from_millis);
    prop_oneof![
        30 => any_fact().prop_map(Step::Fact),
        12 => (0..300u64).prop_map(|ms| Step::Pass(Duration::from_millis(ms))),
        4 => (0..40u32).prop_map(|seconds| Step::Pass(seconds * SECOND)),
        2 => (0..700u32).prop_map(|seconds| Step::Pass(seconds * SECOND)),
        2 => jump.prop_map(Step::Jump),
        2 => Just(Step::Still),
    ]
}

/// Mostly the defaults, otherwise any limits that a config may hold.
pub(super) fn any_limits() -> impl Strategy<Value = Limits> {
    let time = || prop_oneof![Just(0.05), 0.05..10.0, Just(86_400.0)];
    let time = move || time().prop_map(|seconds| Seconds::new(seconds).unwrap());
    let levels = (0..98u8, 1..99u8, 1..99u8).prop_map(|(critical, low, ok)| {
        let low = critical.saturating_add(low).min(99);
        let level = |percent| Percent::new(percent).unwrap();
        (
            level(critical),
            level(low),
            level(low.saturating_add(ok).min(100)),
        )
    });
    let times = (
        time(),
        time(),
        time(),
        time(),
        time(),
        time(),
        time(),
        time(),
    );
    let count = || prop_oneof![0..3u32, Just(u32::MAX)];
    let odd = (levels, times, count(), any::<bool>());
    let odd = odd.prop_map(
        |((critical, low, ok), times, dock_retries, blind_moves)| Limits {
            low,
            ok,
            critical,
            dock_timeout: times.0,
            charge_timeout: times.1,
            dock_retries,
            dock_pause: times.2,
            power_silence: times.3,
            host_silence: times.4,
            host_grace: times.5,
            host_idle_silence: Limits::default().host_idle_silence,
            stream_silence: times.6,
            alarm_every: times.7,
            blind_moves,
            rescue_time: times.2,
            rescue_power: ok,
            rescue: if dock_retries == 1 {
                Rescue::Off
            } else {
                Rescue::Builtin
            },
        },
    );
    prop_oneof![4 => Just(Limits::default()), 1 => odd]
}

/// A robot with a low battery that does not find its station in the first attempts, and perhaps is
/// told to stop soon after.
fn lost() -> impl Strategy<Value = Vec<Step>> {
    let stop = prop::option::weighted(0.4, 0..2500u64);
    (9..20u8, stop).prop_map(|(percent, stop)| {
        let power = Power {
            percent,
            charging: false,
        };
        let not_found = Step::Fact(Fact::Engine(EngineReport::BaseNotFound));
        let login = Step::Fact(Fact::LinkUp {
            docked: false,
            power,
        });
        let tries = [20, 20, 20, 0].map(|pause| [not_found.clone(), Step::Pass(pause * SECOND)]);
        let wait = |ms| Step::Pass(Duration::from_millis(ms));
        let stop = stop.map(|ms| [wait(ms), Step::Fact(Stop::Asked.fact())]);
        let all = std::iter::once(login).chain(tries.into_iter().flatten());
        all.chain(stop.into_iter().flatten()).collect()
    })
}

/// Nearly always begins with a login: without one nothing can go wrong.
pub(super) fn any_history() -> impl Strategy<Value = Vec<Step>> {
    let login = any_power().prop_map(|power| {
        Step::Fact(Fact::LinkUp {
            docked: false,
            power,
        })
    });
    let rest = prop::collection::vec(any_step(), 1..80);
    let login = prop::option::weighted(0.95, login).prop_map(|login| login.into_iter().collect());
    let begin = prop_oneof![8 => login, 1 => lost()];
    (begin, rest).prop_map(|(begin, rest): (Vec<Step>, Vec<Step>)| [begin, rest].concat())
}
