use super::*;

#[test]
fn wait_returns_the_seconds_that_passed() {
    let mut rig = Rig::new("print(task.wait(1.5) >= 1.5, task.now())");
    assert!(rig.log.is_empty());
    rig.pass(1.0);
    assert!(rig.log.is_empty());
    rig.pass(1.0);
    assert_eq!(rig.texts(), ["true 1.5"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn spawned_tasks_run_in_the_order_of_their_creation_after_the_spawner() {
    let text = printed(
        "for i = 1, 3 do task.spawn(function(a, b) print(i, a, b) end, i * 10, nil) end print('main')",
    );
    assert_eq!(text, "main\n1 10 nil\n2 20 nil\n3 30 nil");
}

#[test]
fn timers_of_equal_time_fire_in_the_order_in_which_they_were_set() {
    let mut rig = Rig::new(
        "for i = 1, 5 do task.delay(1, print, i) end task.delay(0.5, print, 'first') task.wait(1) print('main')",
    );
    rig.pass(2.0);
    assert_eq!(rig.texts(), ["first", "1", "2", "3", "4", "5", "main"]);
}

#[test]
fn every_keeps_its_beat_and_counts_the_beats_it_missed() {
    let mut rig = Rig::new(
        "local n = 0
         beat = task.every(1, function(missed)
             n += 1
             print(task.now(), missed, beat.missed)
             if n == 2 then task.wait(2.5) end
             if n == 4 then beat:cancel() end
         end)",
    );
    rig.pass(10.0);
    assert_eq!(rig.texts(), ["1 0 0", "2 0 0", "5 2 2", "6 0 2"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn a_task_has_a_status() {
    let mut rig = Rig::new(
        "good = task.spawn(function() task.wait(1) end)
         bad = task.spawn(function() error('no') end)
         gone = task.spawn(function() task.wait(100) end)
         print(good.status, bad.status, gone.status)
         gone:cancel()
         print(bad:join())
         print(good:join(0.5))
         print(good:join())
         print(good.status, bad.status, gone.status, gone:join())",
    );
    rig.pass(3.0);
    assert_eq!(
        rig.logged(Level::Info),
        [
            "running running running",
            "false failed test.lua:2: no",
            "false timeout",
            "true done",
            "done failed cancelled false cancelled",
        ]
    );
}

#[test]
fn a_cancelled_wait_raises_so_that_clean_up_runs() {
    let rig = Rig::new(
        "local t = task.spawn(function()
             local ok, why = pcall(task.wait, 10)
             print('cleaning', ok, why)
             robot.led('left', false)
         end)
         task.spawn(function() t:cancel() print('asked') end)",
    );
    assert_eq!(
        rig.texts(),
        ["asked", "cleaning false test.lua:2: cancelled"]
    );
    assert_eq!(rig.intents.len(), 1);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn pcall_cannot_end_a_cancellation() {
    let rig = Rig::new(
        "local t = task.spawn(function()
             while true do
                 pcall(function() while true do pcall(task.wait, 1) end end)
             end
         end)
         task.spawn(function() t:cancel() task.spawn(function() print(t.status) end) end)",
    );
    assert_eq!(rig.texts(), ["cancelled"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn a_task_that_cancels_itself_continues_until_it_waits() {
    let rig = Rig::new(
        "local t
         t = task.spawn(function()
             t:cancel() print('still here')
             task.wait(1) print('never')
         end)",
    );
    assert_eq!(rig.texts(), ["still here"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn a_task_cancelled_before_it_begins_never_begins() {
    let mut rig = Rig::new(
        "task.spawn(function() print('no') end):cancel() task.delay(1, print, 'no'):cancel()",
    );
    rig.pass(2.0);
    assert!(rig.log.is_empty());
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn all_returns_the_first_result_of_each() {
    let mut rig = Rig::new(
        "print(task.all(
             function() task.wait(2) return 'a', 'x' end,
             function() end,
             function() return 'c' end))
         print('none', task.all())",
    );
    rig.pass(3.0);
    assert_eq!(rig.texts(), ["a nil c", "none"]);
}

#[test]
fn all_fails_with_the_first_failure_and_cancels_the_others() {
    let mut rig = Rig::new(
        "print(pcall(task.all,
             function() robot.move(10, 10) task.wait(9) print('never') end,
             function() task.wait(1) error('broken') end))",
    );
    rig.pass(10.0);
    assert_eq!(rig.texts(), ["false test.lua:3: broken"]);
    assert!(matches!(
        rig.intents[..],
        [Intent::Move { .. }, Intent::Release { .. }]
    ));
}

#[test]
fn race_cancels_the_losers_and_their_motion() {
    let mut rig = Rig::new(
        "print(task.race(
             function() robot.move(50, 50) local ok = pcall(task.wait, 9) print('cleaned', ok) end,
             function() task.wait(1) return 'won', 2 end))",
    );
    rig.pass(0.5);
    let intents = rig.take_intents();
    let [Intent::Move { motion, .. }] = intents[..] else {
        panic!("{intents:?}");
    };
    rig.pass(1.0);
    assert_eq!(rig.take_intents(), [Intent::Release { motion }]);
    assert_eq!(rig.texts(), ["cleaned false", "won 2"]);
}

#[test]
fn timeout_returns_the_results_or_false_if_it_is_too_late() {
    let mut rig = Rig::new(
        "print(task.timeout(1, function(a) return a, 'b' end, 'a'))
         print(task.timeout(1, function() robot.move(50, 50) task.wait(9) end))
         print(pcall(task.timeout, 1, function() error('broken', 0) end))",
    );
    rig.pass(3.0);
    assert_eq!(
        rig.texts(),
        ["true a b", "false timeout", "false test.lua:3: broken"]
    );
    assert!(matches!(rig.intents[1], Intent::Release { .. }));
}

#[test]
fn groups_within_groups_are_cancelled_with_their_parent() {
    let mut rig = Rig::new(
        "task.timeout(1, function()
             task.all(
                 function() pcall(task.wait, 9) print('inner') end,
                 function() task.timeout(5, function() pcall(task.wait, 9) print('innermost') end) end)
         end)
         print('outer')",
    );
    rig.pass(2.0);
    assert_eq!(rig.texts(), ["inner", "innermost", "outer"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn at_most_256_tasks_live_at_once() {
    let text = failure("while true do task.spawn(task.wait, 10) end");
    assert!(text.starts_with("test.lua:1: task.spawn: 256 tasks are running already"));
}

#[test]
fn tasks_that_never_let_time_pass_are_slowed() {
    let mut rig = Rig::loaded(
        "local function again() task.spawn(again) end again()
         task.spawn(function() while true do task.timeout(1, function() end) end end)",
        |_| {},
    );
    let mut slices = 0;
    while {
        rig.script.run_ready(rig.now);
        rig.script.is_ready()
    } {
        slices += 1;
        assert!(slices < 10_000, "time stands still");
    }
    assert!(rig.script.next_deadline().is_some_and(|at| at > rig.now));
}

#[test]
fn a_wait_inside_a_coroutine_makes_the_whole_task_wait() {
    let mut rig = Rig::new(
        "local co = coroutine.create(function(a)
             local waited = task.wait(1)
             local b = coroutine.yield(a, waited)
             task.wait(1)
             return b, 'end'
         end)
         task.spawn(function() task.wait(0.5) print('other', coroutine.status(co), coroutine.resume(co)) end)
         print(coroutine.resume(co, 'a'))
         print(coroutine.resume(co, 'b'))
         print(coroutine.status(co), coroutine.resume(co))
         local inner = coroutine.wrap(function() task.wait(1) coroutine.yield('x') error('boom', 0) end)
         local outer = coroutine.wrap(function() coroutine.yield(inner()) inner() end)
         print(outer())
         print(pcall(outer))",
    );
    rig.pass(10.0);
    assert_eq!(
        rig.texts(),
        [
            "other normal false cannot resume a coroutine that waits",
            "true a 1",
            "true b end",
            "dead false cannot resume dead coroutine",
            "x",
            "false boom",
        ]
    );
}

#[test]
fn an_iterator_may_wait() {
    let mut rig = Rig::new(
        "local function counts() for i = 1, 3 do task.wait(1) coroutine.yield(i) end end
         for i in coroutine.wrap(counts) do print(i, task.now()) end",
    );
    rig.pass(9.0);
    assert_eq!(rig.texts(), ["1 1", "2 2", "3 3"]);
}

#[test]
fn waiting_where_nothing_can_wait_is_an_error_with_its_place() {
    for source in [
        "table.sort({1, 2, 3}, function(a, b) task.wait(1) return a < b end)",
        "local co = coroutine.wrap(function() task.wait(1) end)\ntable.sort({1, 2}, function(a, b) co() return a < b end)",
        "return setmetatable({}, {__index = function() robot.move(1, 1, 1) end}).x",
    ] {
        let rig = Rig::new(source);
        rig.assert_ended(EndReason::Error, "nothing can wait here");
        assert!(rig.intents.is_empty());
        assert!(rig.exit().message.unwrap().starts_with("test.lua:1: "));
    }
}

#[test]
fn yielding_outside_a_coroutine_is_an_error_with_advice() {
    let text = failure("\ncoroutine.yield(1)");
    assert!(text.starts_with("test.lua:2: coroutine.yield: "), "{text}");
    assert!(text.contains("task.wait"));
}

#[test]
fn a_failed_task_is_logged_and_the_script_continues_and_ends_with_its_error() {
    let mut rig = Rig::new(
        "for _ = 1, 10 do task.spawn(function() local t = nil; t.x = 1 end) end task.wait(1) print('on')",
    );
    rig.pass(2.0);
    let errors = rig.logged(Level::Error);
    assert_eq!(errors.len(), 2, "{errors:?}");
    assert!(errors[0].starts_with("test.lua:1: ") && errors[0].contains("nil"));
    assert!(errors[1].ends_with("(10 times)"));
    rig.assert_ended(EndReason::Error, "(a task failed)");
}

#[test]
fn a_failed_task_that_was_joined_is_the_scripts_own_affair() {
    for wait in ["", "task.wait(1)"] {
        let mut rig = Rig::new(&format!(
            "local one = task.spawn(function() task.wait(0.5) error('x') end) {wait} print(one:join())",
        ));
        rig.pass(3.0);
        rig.assert_ended(EndReason::Done, "");
    }
}

#[test]
fn a_task_that_failed_counts_when_the_run_ends_too() {
    let mut rig = Rig::new("robot.on('noise', print) task.delay(1, error, 'x')");
    rig.pass(2.0);
    rig.script.stop(EndReason::Shutdown, rig.now);
    rig.pass(1.0);
    rig.assert_ended(EndReason::Error, "x");
}
