use super::*;
use crate::robot::EndReason;

#[test]
fn the_script_ends_when_nothing_is_left() {
    let mut rig = Rig::new("task.delay(1, print, 'late') print(script.name)");
    assert!(rig.script.ended().is_none());
    rig.pass(2.0);
    assert_eq!(rig.texts(), ["test", "late"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn a_handler_keeps_the_script_alive() {
    let mut rig = Rig::new("local s s = robot.on('docked', function() s:off() end)");
    rig.pass(100.0);
    assert!(rig.script.ended().is_none());
    rig.deliver(Event::Docked);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn script_stop_ends_everything_with_its_text() {
    let rig = Rig::new(
        "task.spawn(function() while true do task.wait(1) end end)
         robot.on('docked', print)
         script.on_stop(function(reason) print('bye', reason) end)
         pcall(function() script.stop('enough') end)
         print('never')",
    );
    assert_eq!(rig.texts(), ["bye done"]);
    rig.assert_ended(EndReason::Done, "enough");
}

#[test]
fn on_stop_runs_last_and_cannot_move() {
    let mut rig = Rig::new(
        "script.on_stop(function(reason)
             print('first', reason, robot.move(50, 50))
             print(robot.forward(1), robot.dock())
             robot.led('left', false)
             task.wait(0.1)
             print(pcall(task.spawn, print))
             print(pcall(robot.on, 'docked', print))
         end)
         script.on_stop(function() print('second') error('oops') end)
         task.spawn(function() pcall(task.wait, 100) print('cleaned', robot.move(1, 1)) end)
         robot.move(20, 20)
         task.wait(100)",
    );
    let intents = rig.take_intents();
    let [Intent::Move { motion, .. }] = intents[..] else {
        panic!("{intents:?}");
    };
    rig.script.stop(EndReason::Cancelled, rig.now);
    rig.collect();
    assert_eq!(rig.intents[0], Intent::Release { motion });
    assert!(!rig.script.has_motion());
    assert!(rig.script.ended().is_none());
    rig.pass(1.0);
    assert_eq!(
        rig.logged(Level::Info),
        [
            "cleaned false cancelled",
            "first cancelled false cancelled",
            "false false cancelled",
            "false test.lua:6: task.spawn: the script is ending, nothing new can begin",
            "false test.lua:7: robot.on: the script is ending, nothing new can begin",
            "second",
        ]
    );
    assert_eq!(rig.logged(Level::Error), ["test.lua:9: oops"]);
    assert!(
        !rig.intents
            .iter()
            .any(|one| matches!(one, Intent::Move { .. }))
    );
    rig.assert_ended(EndReason::Cancelled, "");
}

#[test]
fn on_stop_has_half_a_second() {
    let mut rig = Rig::new(
        "script.on_stop(function() task.wait(0.4) print('a') task.wait(0.4) print('b') end)",
    );
    assert!(rig.script.ended().is_none());
    rig.pass(0.49);
    assert_eq!(rig.texts(), ["a"]);
    assert!(rig.script.ended().is_none());
    rig.pass(0.02);
    rig.assert_ended(EndReason::Done, "");
    rig.pass(1.0);
    assert_eq!(rig.texts(), ["a"]);
}

#[test]
fn an_on_stop_that_hangs_does_not_change_the_reason() {
    let mut rig = Rig::with(
        "script.on_stop(function() while true do end end) task.wait(9)",
        |options| options.limits.callback_budget_ms = 50,
    );
    rig.script.stop(EndReason::Reload, rig.now);
    rig.collect();
    rig.assert_ended(EndReason::Reload, "");
    assert!(rig.logged(Level::Warn)[0].contains("while stopping"));
}

#[test]
fn a_kill_runs_no_further_line() {
    for reason in [EndReason::Safety, EndReason::Cpu, EndReason::Memory] {
        let mut rig = Rig::new(
            "script.on_stop(print) robot.move(9, 9) pcall(task.wait, 9) robot.led('all', true)",
        );
        let motion = rig.take_intents();
        assert_eq!(motion.len(), 1);
        rig.script.stop(reason, rig.now);
        rig.pass(20.0);
        rig.assert_ended(reason, "");
        assert!(matches!(rig.intents[..], [Intent::Release { .. }]));
        assert!(rig.log.is_empty());
        rig.deliver(Event::Docked);
        assert!(rig.script.next_deadline().is_none());
    }
}

#[test]
fn the_main_tasks_failure_ends_the_script() {
    let mut rig = Rig::new(
        "task.spawn(function() robot.move(10, 10) task.wait(9) end)
         task.wait(1)
         error('broken')",
    );
    rig.pass(2.0);
    rig.assert_ended(EndReason::Error, "test.lua:3: broken");
    assert!(matches!(rig.intents[1], Intent::Release { .. }));
}

#[test]
fn an_internal_fault_ends_the_script_and_no_pcall_hides_it() {
    let mut rig = Rig::new(
        "robot.move(10, 10) task.wait(1)
         pcall(script.fault) robot.move(90, 90) while true do task.wait(1) robot.move(90, 90) end",
    );
    let motion = rig.take_intents();
    rig.pass(5.0);
    rig.assert_ended(EndReason::Error, "a fault inside spykee");
    assert_eq!(motion.len(), 1);
    assert!(matches!(rig.intents[..], [Intent::Release { .. }]));
}

#[test]
fn usage_is_reported() {
    let rig = Rig::new(
        "local u = script.usage()
         print(u.cpu_ms >= 0, u.worst_callback_ms >= 0, u.memory_bytes > 100000)",
    );
    assert_eq!(rig.texts(), ["true true true"]);
    let usage = rig.script.usage();
    assert!(usage.memory_bytes > 100_000);
    assert!(usage.worst_callback > Duration::ZERO && usage.worst_callback <= usage.cpu);
}

#[test]
fn logs_carry_level_fields_and_line() {
    let rig = Rig::new(
        "log.debug('a') log.info('b', {speed = 40, deep = {1, {x = {y = {}}}}})
         log.warn(nil == nil)
         log.error({} ~= nil, {})
         print('x', 1, nil, true)
         print(pcall(log.info))
         print(pcall(log.info, 'x', 5))",
    );
    let line = &rig.log[1];
    assert_eq!(line.level, Level::Info);
    assert_eq!(line.line, Some(1));
    assert_eq!(
        line.fields,
        [
            ("deep".to_owned(), "{1, {x={y={...}}}}".to_owned()),
            ("speed".to_owned(), "40".to_owned())
        ]
    );
    assert_eq!(rig.log[2].line, Some(2));
    assert_eq!(rig.texts()[3], "x 1 nil true");
    assert!(rig.texts()[4].contains("log.info: the text is missing"));
    assert!(rig.texts()[5].contains("the fields must be a table"));
}

#[test]
fn floods_of_log_lines_are_dropped_and_counted() {
    let mut rig = Rig::new("for i = 1, 412 do print(i) end task.wait(5) print('end')");
    assert_eq!(rig.log.len(), 100);
    rig.pass(10.0);
    assert_eq!(rig.texts()[100..], ["... and 312 more lines", "end"]);
}

#[test]
fn long_texts_are_cut_and_cannot_control_the_terminal() {
    let rig = Rig::new(
        "local t = {} t.t = t for i = 1, 1000 do t[i] = t end
         print(('x'):rep(1e6)) log.info('\\27[2Ja\\nb', {k = ('y'):rep(1e6), t = t})",
    );
    assert!(rig.log[0].text.chars().count() <= 1025);
    assert_eq!(rig.log[1].text, "[2Ja\nb");
    let length: usize = rig.log[1].fields.iter().map(|(_, text)| text.len()).sum();
    assert!(length < 3000, "{length}");
}

#[test]
fn garbage_does_not_use_up_the_memory() {
    for waste in [
        "local t = {} for j = 1, 50 do t[j] = {j} end",
        "local s = ('x'):rep(50000) .. i",
        "local b = buffer.create(100000)",
    ] {
        let mut rig = Rig::new(&format!(
            "keep = {{}} for i = 1, 5000 do keep[i] = buffer.create(1000) end
             for _ = 1, 20 do for i = 1, 200 do {waste} end task.wait(0.01) end"
        ));
        rig.pass(1.0);
        rig.assert_ended(EndReason::Done, "");
    }
}

#[test]
fn options_survive_serialization_to_another_process() {
    let mut options = Options::new("a", "b.lua");
    let ball = crate::vision::Colour::lab([10.0, 20.0], [0.0, 5.0], [1.0, 2.0]).unwrap();
    options.colours.insert("ball".to_owned(), ball);
    let bytes = postcard::to_allocvec(&options).unwrap();
    let back: Options = postcard::from_bytes(&bytes).unwrap();
    assert_eq!(back.colours["ball"], ball);
    assert_eq!(
        (back.limits, back.calibration),
        (options.limits, options.calibration)
    );
}
