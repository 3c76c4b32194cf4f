//! The scenarios: name, fault, promise, and the check.

use std::future::Future;
use std::pin::Pin;

use super::fault_run::FaultRun;
use super::{network, robot};

/// What the behaviour does during the fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Script {
    /// Drives short moves.
    Drives,
    /// Drives short moves and analyses pictures.
    Watches,
    /// Drives without a pause and analyses pictures.
    Cruises,
}

/// One way in which networks or robots break, and the agent's promise in that case.
pub struct Scenario {
    pub name: &'static str,
    /// In the format of `spykee sim --faults`.
    pub fault: &'static str,
    pub promise: &'static str,
    pub script: Script,
    pub act: fn(FaultRun) -> Pin<Box<dyn Future<Output = ()> + Send>>,
}

macro_rules! scenarios {
    ($($name:literal, $fault:literal, $promise:literal, $module:ident::$act:ident, $script:ident;)+) => {
        &[$(Scenario {
            name: $name,
            fault: $fault,
            promise: $promise,
            script: Script::$script,
            act: |fault_run| Box::pin($module::$act(fault_run)),
        },)+]
    };
}

pub const SCENARIOS: &[Scenario] = scenarios! {
    "late bytes", "{fault: delay, seconds: 0.15, jitter: 0.1}",
        "messages arrive late but in order; the script drives on", network::drives_on, Drives;
    "bytes in pieces", "{fault: split}",
        "every message is reassembled, pictures too", network::drives_and_sees_on, Watches;
    "slow pictures", "{fault: drip, bytes: 40000, towards: client}",
        "the script sees fewer pictures and drives on", network::drives_and_sees_on, Watches;
    "a very slow link", "{fault: drip, bytes: 400, towards: client, for: 8}",
        "when hardly any bytes arrive from the robot, the tracks are stopped; then reconnect", network::stops_first, Cruises;
    "everything late and in pieces", "{fault: split}, {fault: delay, seconds: 0.05, jitter: 0.1}, {fault: drop, after: 0.5}",
        "a reconnect works over a bad link too; the first command is a stop", network::comes_back, Drives;
    "dropped connection", "{fault: drop}",
        "the script receives `disconnected`; after the reconnect the first command is a stop", network::comes_back, Drives;
    "dropped again and again", "{fault: drop, every: 0.8}",
        "every new session begins with a stop, and the script continues", network::comes_back_each_time, Drives;
    "reset in mid-frame", "{fault: reset}",
        "half a picture does no harm; reconnect, a stop first, pictures again", network::comes_back_and_sees, Watches;
    "half-open both ways", "{fault: half_open, for: 2}",
        "when a driving robot falls silent: reconnect; nothing queues behind the dead socket", network::queues_nothing, Cruises;
    "half-open between short moves", "{fault: half_open, for: 2}",
        "short moves over a dead link cause a reconnect too", network::queues_nothing, Watches;
    "half-open from the robot", "{fault: half_open, towards: client, for: 2}",
        "the tracks are stopped over the old connection before it is closed", network::stops_first, Cruises;
    "half-open to the robot", "{fault: half_open, towards: robot, for: 1}, {fault: reset, after: 0.3}",
        "commands that the robot missed are not repeated; it receives a stop", network::queues_nothing, Drives;
    "interrupted on a dead link", "{fault: half_open}",
        "Ctrl-C still ends the program within about 2 s, and says that the robot may be driving", network::ends_in_time, Drives;
    "garbage from the robot", "{fault: garbage, bytes: 300}",
        "a stream that lost synchronisation is closed; reconnect, a stop first", network::comes_back, Drives;
    "garbage to the robot", "{fault: garbage, bytes: 300, towards: robot}",
        "the robot closes the connection; reconnect, a stop first", network::comes_back, Drives;
    "a header that claims too little", "{fault: length_lie, bytes: 0}",
        "the stream has lost synchronisation and is closed; reconnect, a stop first", network::comes_back, Drives;
    "a header that claims 64 KiB", "{fault: length_lie, bytes: 65535}",
        "no further message is complete, which counts as silence: a stop, then reconnect", network::stops_first, Cruises;
    "pictures of 64 KiB", "{fault: huge_frames}",
        "scripts see them like all others", network::sees_huge_pictures, Watches;
    "pictures cut off", "{fault: truncated_frames, for: 2}",
        "scripts find nothing in them, and the log says so; the script drives on and sees the next good one", network::overlooks_bad_pictures, Watches;
    "pictures with wrong bytes", "{fault: flipped_frames, bytes: 40, for: 2}",
        "the script may find wrong things in them; it drives on and sees the next good one", network::overlooks_bad_pictures, Watches;
    "a reboot", "{fault: reboot, state: lost, for: 1}",
        "new login, a stop first, and the streams are on again", robot::starts_afresh, Watches;
    "Wi-Fi gone for a while", "{fault: reboot, state: kept, for: 1}",
        "a robot that kept driving meanwhile first receives a stop", robot::stops_one_that_drove_on, Cruises;
    "refused: in use", "{fault: refuse_login, reason: busy, for: 1.5}, {fault: drop}",
        "retries until the login succeeds; requests made meanwhile are dropped", robot::is_let_in_again, Drives;
    "refused: wrong password", "{fault: refuse_login, reason: password, for: 1.5}, {fault: drop}",
        "a robot that has accepted the password before is retried; the script continues", robot::is_let_in_again, Drives;
    "a program that is slow for a while", "{fault: slow_program, commands_per_second: 4, for: 4}",
        "commands are sent only as fast as they are executed; the script drives on", network::drives_on, Drives;
    "a second user takes over", "{fault: take_over, for: 1.5}",
        "the script receives `disconnected`; the agent returns when the other user has gone", robot::waits_for_the_other, Drives;
    "no battery level", "{fault: no_power}",
        "silence counts as low: stop and BASE_FIND", robot::silence_counts_as_low, Drives;
    "no battery level after the login", "{fault: no_power, for: 12}, {fault: drop}",
        "nothing moves before the first level has arrived", robot::waits_for_a_level, Drives;
    "a battery level that jumps", "{fault: power_jumps, percent: 5, for: 3}",
        "one low level is enough: stop and BASE_FIND in one write; no motion until it is good again", robot::goes_home_in_one_write, Drives;
    "battery levels of random bytes", "{fault: power_garbage, chance: 0.4}",
        "one low level is enough; the garbage that follows does not release the robot, and it still gets home", robot::gets_home_through_garbage, Drives;
    "low on a bad link", "{fault: split}, {fault: delay, seconds: 0.2, jitter: 0.1}",
        "a low battery still sends the robot home", robot::goes_home_though, Drives;
    "low while the link is down", "{fault: reboot, state: kept, for: 1}",
        "after the reconnect: a stop, BASE_FIND, and no motion", robot::goes_home_after_the_reconnect, Drives;
    "the station is never found", "{fault: base_not_found}",
        "a short, slow, blind move before each further search, again and again; later also the alarm", robot::alarms_and_searches_on, Drives;
    "a station without current", "{fault: no_charge}",
        "docked without charging is not home: the robot stays there and sounds the alarm", robot::stays_on_the_dead_station, Drives;
    "docking lost again", "{fault: dock_lost, seconds: 0.5}",
        "a low robot that slides off its station goes home again", robot::goes_home_again, Drives;
};
