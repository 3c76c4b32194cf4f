use super::vision::show;
use super::*;
use crate::robot::{Battery, Percent, SafetyAction};
use bytes::Bytes;

fn battery(percent: u8, charging: bool) -> Battery {
    Battery {
        percent: Percent::new(percent),
        charging,
        minutes_left: None,
    }
}

/// Size, a scan and an end marker: enough for a frame that is not decoded.
const MARKERS: &[u8] = b"\xFF\xD8\xFF\xC0\0\x0B\x08\0\xF0\x01\x40\x01\x01\x11\0\
                         \xFF\xDA\0\x08\x01\x01\0\0\x3F\0\x55\xFF\xD9";

/// Delivers a frame of `size` bytes, most of them padding.
fn deliver_frame(rig: &mut Rig, seq: u64, size: usize) {
    let mut jpeg = MARKERS.to_vec();
    jpeg.resize(size, 0);
    show(rig, seq, &Bytes::from(jpeg));
}

#[test]
fn every_event_reaches_its_handler_with_its_payload() {
    let mut rig = Rig::new(
        "local function show(name)
             robot.on(name, function(e)
                 local keys = {}
                 for k, v in pairs(e) do table.insert(keys, k .. '=' .. tostring(v)) end
                 table.sort(keys)
                 print(name, table.concat(keys, ' '))
             end)
         end
         for _, name in {'connected', 'disconnected', 'battery', 'battery_low', 'battery_ok', 'charging', 'charged',
             'docked', 'undocked', 'base_not_found', 'sound_finished', 'safety', 'engine'} do show(name) end",
    );
    for event in [
        connected(false),
        Event::Battery(battery(80, false)),
        Event::BatteryLow(battery(20, false)),
        Event::BatteryOk(battery(50, true)),
        Event::Charging { on: true },
        Event::Charged,
        Event::Docked,
        Event::Undocked,
        Event::BaseNotFound,
        Event::SoundFinished,
        Event::Safety {
            action: SafetyAction::Dock,
            reason: "low".to_owned(),
        },
        Event::Engine { code: 77 },
        Event::Disconnected {
            reason: "gone".to_owned(),
        },
    ] {
        rig.deliver(event);
    }
    assert_eq!(
        rig.texts(),
        [
            "connected address=172.17.6.1:9000",
            "battery age=0 charging=false percent=80",
            "battery_low age=0 charging=false percent=20",
            "battery_ok age=0 charging=true percent=50",
            "charging on=true",
            "charged ",
            "docked ",
            "undocked ",
            "base_not_found ",
            "sound_finished ",
            "safety action=dock reason=low",
            "engine code=77",
            "disconnected reason=gone",
        ]
    );
}

#[test]
fn an_unknown_event_is_an_error_with_the_nearest_and_all_names() {
    let text = failure("robot.on('batery', print)");
    assert!(
        text.contains("unknown event 'batery'; did you mean 'battery'?"),
        "{text}"
    );
    assert!(text.contains("sound_finished"));
    assert!(failure("robot.wait_for(5)").contains("event must be one of connected"));
}

#[test]
fn wait_for_returns_the_payload_or_a_timeout() {
    let mut rig = Rig::new(
        "print(robot.wait_for('engine', 1)) print(robot.wait_for('engine', 5).code) print(type(robot.wait_for('docked')))",
    );
    rig.pass(1.5);
    rig.deliver(Event::Engine { code: 9 });
    rig.deliver(Event::Docked);
    assert_eq!(rig.texts(), ["nil timeout", "9", "table"]);
}

#[test]
fn once_runs_once() {
    let mut rig = Rig::new("robot.once('engine', function(e) print(e.code) end) task.wait(9)");
    rig.deliver(Event::Engine { code: 1 });
    rig.deliver(Event::Engine { code: 2 });
    assert_eq!(rig.texts(), ["1"]);
}

#[test]
fn a_handler_runs_one_event_at_a_time_in_order() {
    let mut rig = Rig::new("robot.on('engine', function(e) print(e.code) task.wait(1) end)");
    for code in 1..=3 {
        rig.deliver(Event::Engine { code });
    }
    assert_eq!(rig.texts(), ["1"]);
    rig.pass(1.5);
    assert_eq!(rig.texts(), ["1", "2"]);
    rig.pass(5.0);
    assert_eq!(rig.texts(), ["1", "2", "3"]);
}

#[test]
fn queues_hold_64_and_count_what_they_drop() {
    let mut rig = Rig::new(
        "local n = 0 robot.on('engine', function(e) n += 1 if n == 1 then task.wait(1) end last = e.code end)
         task.delay(2, function() print(n, last) end)",
    );
    for code in 0..=84 {
        rig.script.deliver(Event::Engine { code }, rig.now);
        rig.run();
    }
    rig.pass(3.0);
    assert_eq!(rig.logged(Level::Info), ["65 64"]);
    let warnings = rig.logged(Level::Warn);
    assert_eq!(warnings.len(), 2);
    assert!(warnings[1].ends_with("10 dropped"));
}

#[test]
fn the_queue_can_be_chosen() {
    let mut rig = Rig::new(
        "robot.on('engine', function(e) print(e.code) task.wait(1) end, {queue = 'latest'})",
    );
    for code in 1..=5 {
        rig.deliver(Event::Engine { code });
    }
    rig.pass(9.0);
    assert_eq!(rig.texts(), ["1", "5"]);
    assert!(
        failure("robot.on('engine', print, {queue = 'latst'})").contains("did you mean 'latest'?")
    );
    assert!(failure("robot.on('engine', print, {rates = 1})").contains("did you mean 'rate'?"));
}

#[test]
fn a_rate_spaces_the_runs() {
    let mut rig =
        Rig::new("robot.on('frame', function(f) print(f.seq, task.now()) end, {rate = 2})");
    for seq in 1..=20 {
        deliver_frame(&mut rig, seq, 100);
        rig.pass(0.1);
    }
    assert_eq!(rig.texts(), ["1 0", "5 0.5", "10 1", "15 1.5", "20 2"]);
}

#[test]
fn a_failing_handler_is_logged_rarely_and_stays() {
    let mut rig = Rig::new(
        "local n = 0
         robot.on('engine', function(e)
             n += 1
             if n % 5 ~= 0 then error('bad') end
             print('good')
         end)",
    );
    for _ in 0..20 {
        rig.deliver(Event::Engine { code: 1 });
    }
    assert_eq!(rig.logged(Level::Info), ["good"; 4]);
    assert_eq!(
        rig.logged(Level::Error),
        ["test.lua:4: bad", "test.lua:4: bad (10 times)"]
    );
    assert!(rig.script.ended().is_none());
}

#[test]
fn five_failures_in_a_row_end_the_script() {
    let mut rig = Rig::new("robot.on('engine', function(e) robot.moev(e.code, 0) end)");
    for code in 0..4 {
        rig.deliver(Event::Engine { code });
        assert!(rig.script.ended().is_none());
    }
    rig.deliver(Event::Engine { code: 5 });
    rig.assert_ended(
        EndReason::Error,
        "robot.moev does not exist; did you mean 'move'?",
    );
    rig.assert_ended(EndReason::Error, "'engine' handler failed 5 times in a row");
}

#[test]
fn the_newest_frame_wins() {
    let mut rig = Rig::new(
        "robot.on('frame', function(f) print(f.seq, f.bytes, f.age) task.wait(1) end)
         task.delay(1.5, function() print(robot.frame().seq) task.wait(5) print(robot.frame()) end)",
    );
    for seq in 1..=4 {
        deliver_frame(&mut rig, seq, 100);
        rig.pass(0.2);
    }
    rig.pass(9.0);
    assert_eq!(rig.texts()[..2], ["1 100 0", "4 100 0.4"]);
    assert_eq!(rig.texts()[2..], ["4", "nil"]);
}

#[test]
fn the_size_of_kept_frames_is_bounded() {
    let mut rig = Rig::with(
        "keep = {} robot.on('frame', function(f) if f.seq > 100 then table.insert(keep, f) end end)",
        |options| options.limits.memory_bytes = 1 << 20,
    );
    for seq in 1..=100 {
        deliver_frame(&mut rig, seq, 10_000);
    }
    assert!(rig.script.ended().is_none());
    for seq in 101..=220 {
        deliver_frame(&mut rig, seq, 10_000);
    }
    rig.assert_ended(EndReason::Memory, "of frames");
}

#[test]
fn the_robots_state_is_known_from_its_events() {
    let mut rig = Rig::new(
        "local function show()
             local b = robot.battery()
             print(robot.connected(), robot.docked(), b and b.percent, b and b.charging, b and b.age, b and b.minutes_left)
         end
         print(robot.info()) show()
         while true do task.wait(1) show() if robot.info() then name = robot.info().uid end end",
    );
    rig.deliver(connected(true));
    rig.pass(1.0);
    rig.deliver(Event::Battery(battery(42, false)));
    rig.deliver(Event::Undocked);
    rig.pass(1.0);
    rig.deliver(Event::Battery(Battery {
        minutes_left: Some(12.5),
        ..battery(43, true)
    }));
    rig.deliver(Event::Disconnected {
        reason: String::new(),
    });
    rig.pass(1.0);
    assert_eq!(
        rig.texts(),
        [
            "nil",
            "false false nil nil nil nil",
            "true true nil nil nil nil",
            "true false 42 false 1 nil",
            "false true 43 true 1 12.5",
        ]
    );
}

#[test]
fn at_most_64_subscriptions() {
    let text = failure("while true do robot.on('docked', print) end");
    assert!(text.contains("there are 64 handlers already"), "{text}");
}

#[test]
fn a_grant_has_its_time_and_its_power() {
    let mut rig =
        Rig::new("robot.on('drive_grant', function(grant) print(grant.seconds, grant.power) end)");
    rig.deliver(Event::DriveGrant {
        seconds: Duration::from_secs(8),
        power: Percent::saturating(30),
    });
    assert_eq!(rig.texts(), ["8 30"]);
}
