//! Scripts that try to run forever, to use all memory, or to drive after their end. The time bounds
//! are generous, since without the guards the scripts would not end at all.

use std::time::Instant as RealTime;

use proptest::prelude::*;

use super::*;

/// Each must end within a few seconds on a busy machine; without the guards all run over 10 s.
const BOUND: Duration = Duration::from_secs(8);

/// Runs hostile code until the script has ended; returns the rig.
#[track_caller]
fn ends(source: &str) -> Rig {
    let began = RealTime::now();
    let mut rig = Rig::with(source, |_| {});
    while rig.script.ended().is_none() && began.elapsed() < BOUND {
        rig.pass(1.0);
    }
    let took = began.elapsed();
    assert!(took < BOUND, "took {took:?}: {source}");
    assert!(rig.script.ended().is_some(), "still alive: {source}");
    // Whatever is delivered now, no intent is sent.
    let intents = rig.intents.len();
    rig.deliver(Event::Docked);
    rig.pass(10.0);
    assert_eq!(rig.intents.len(), intents);
    assert!(!rig.script.has_motion());
    rig
}

#[track_caller]
fn ends_with(reason: EndReason, source: &str) -> Rig {
    let rig = ends(source);
    assert_eq!(rig.exit().reason, reason, "{source}: {:?}", rig.exit());
    rig
}

#[test]
fn a_loop_that_never_waits_is_ended_with_its_line() {
    let rig = ends_with(
        EndReason::Cpu,
        "robot.move(50, 50)\nlocal x = 0\nwhile true do\n x += 1\nend",
    );
    rig.assert_ended(EndReason::Cpu, "ran longer than 100 ms without waiting");
    let message = rig.exit().message.unwrap();
    assert!(
        message.starts_with("test.lua:3") || message.starts_with("test.lua:4"),
        "{message}"
    );
    // The setpoint of the killed slice was never sent.
    assert!(
        !rig.intents
            .iter()
            .any(|one| matches!(one, Intent::Move { .. }))
    );
}

#[test]
fn the_setpoint_of_an_earlier_slice_is_released() {
    let rig = ends_with(
        EndReason::Cpu,
        "robot.move(50, 50) task.wait(0.5) robot.move(90, 90) robot.stop() while true do end",
    );
    assert!(matches!(
        rig.intents[..],
        [Intent::Move { motion, .. }, Intent::Release { motion: released }] if motion == released
    ));
}

#[test]
fn pattern_searches_are_bounded() {
    for source in [
        "local s = ('a'):rep(2e6) print(pcall(string.find, s, ('a'):rep(1e6) .. 'b', 1, true))",
        "local s = ('a'):rep(2e6) print(pcall(string.find, s, ('a'):rep(1e6) .. 'b'))",
        "local s, p = ('a'):rep(2e6), '[' .. ('a'):rep(1e6) .. 'b]*x' for _, f in {string.find, string.match, string.gmatch, string.gsub} do print(pcall(f, s, p, '')) end",
        "local s = ('a'):rep(2e6) print(pcall(string.split, s, s:sub(1, 1e6) .. 'b'))",
    ] {
        let rig = ends_with(EndReason::Done, source);
        assert!(
            rig.texts()[0].contains("too long together"),
            "{:?}",
            rig.texts()
        );
    }
    for source in [
        "('a'):rep(1e4):find(('.-'):rep(30) .. 'b')",
        "('a'):rep(300000):match('.-.-.-b')",
        "('x'):rep(1e6):gsub('.-b', '')",
        "while true do pcall(string.find, ('a'):rep(1e5), ('a*'):rep(50) .. 'b') end",
        "local s = ('a'):rep(2e6) while true do pcall(s.find, s, 'aaaaaaab', 1, true) end",
    ] {
        ends_with(EndReason::Cpu, source);
    }
}

#[test]
fn library_calls_over_wide_ranges_end() {
    for source in [
        "print(pcall(table.move, {}, 1, 2e9, -2e9, {}))",
        "print(pcall(table.move, {}, 1, 2^31 - 2, 2))",
        "print(pcall(table.move, {1, 2, 3}, 1, 2^30, 5, {}))",
        "print(pcall(table.create, 1e8, 0))",
        "print(pcall(table.concat, {}, 'x', 1, 2e9))",
        "print(pcall(table.unpack, {}, 1, 2e9))",
        "print(pcall(string.rep, '', 2e9))",
        "print(pcall(string.format, '%99.99f', 1e300))",
        "print(pcall(string.format, '%9999d', 1))",
        "print(pcall(utf8.len, ('x'):rep(4e6)))",
        "print(pcall(tonumber, ('1'):rep(4e6)))",
        "print(pcall(tonumber, ('z'):rep(4e6), 36))",
        "print(pcall(string.pack, ('i8'):rep(1e6)))",
        "print(pcall(string.packsize, 'c2147483647c2147483647'))",
        "print(pcall(select, -2e9, 1))",
        "print(pcall(bit32.lshift, 1, 2e9))",
        "print(pcall(string.sub, 'x', -2e9, 2e9))",
        "print(pcall(table.find, {}, 1, 2e9))",
        "print(pcall(buffer.fill, buffer.create(4e6), 0, 1))",
        "local t = {} t[2^31] = 1 t[1] = 1 print(#t, pcall(table.insert, t, 1, 2), table.maxn(t))",
    ] {
        ends_with(EndReason::Done, source);
    }
}

#[test]
fn memory_bombs_end_with_memory() {
    for source in [
        "local t = {} while true do t[#t + 1] = {} end",
        "local s = 'x' while true do s ..= s end",
        "return ('x'):rep(1e9)",
        "return buffer.create(1e9)",
        "local t = {} for i = 1, 1e9 do t[i] = ('x'):rep(1000) .. i end",
        "task.spawn(function() return ('x'):rep(1e9) end) task.wait(9)",
        "robot.on('docked', function() end) local b = {} while true do b[#b+1] = buffer.create(100000) end",
    ] {
        let rig = ends_with(EndReason::Memory, source);
        rig.assert_ended(EndReason::Memory, "8192 KiB");
        assert!(rig.script.usage().memory_bytes < 10 * 1024 * 1024);
    }
}

#[test]
fn waiting_does_not_count_against_the_budget() {
    // The task waits longer than its budget, but it does not run meanwhile.
    let mut rig = Rig::loaded("print('a') task.wait(1) print('b')", |options| {
        options.limits.callback_budget_ms = 30;
    });
    rig.run();
    rig.pass(2.0);
    assert_eq!(rig.texts(), ["a", "b"]);
}

fn run(source: &[u8]) {
    let mut options = Options::new("test", "test.lua");
    options.limits.callback_budget_ms = 20;
    let now = Instant::now();
    if let Ok(mut script) = Script::load(source, options, now) {
        for _ in 0..50 {
            script.run_ready(now);
            script.take_output();
        }
        script.stop(EndReason::Cancelled, now);
    }
}

/// Words of the language and of the API, in any order.
fn words() -> impl Strategy<Value = String> {
    let words = "
        robot task script . : ( ) { } move wait spawn on 'frame' 50 -1 0/0 nil function end
        return pcall coroutine wrap yield error = , local x all race timeout cancel stop if then
        for in do while true";
    let words: Vec<&str> = words.split_whitespace().chain(["\n"]).collect();
    let word = prop::sample::select(words);
    prop::collection::vec(word, 0..40).prop_map(|words| words.join(" "))
}

/// A call of the API with values of any kind.
fn call() -> impl Strategy<Value = String> {
    let names = "
        robot.move robot.drive robot.turn robot.led robot.blink robot.play robot.say
        robot.stream robot.dock robot.undock robot.on robot.once robot.wait_for robot.wait_frame
        robot.frame task.wait task.spawn task.delay task.every task.all task.race task.timeout
        script.stop script.on_stop log.info print coroutine.resume coroutine.wrap
        coroutine.close string.split string.gsub table.sort task.spawn(print).join
        task.spawn(print).cancel";
    let methods = ["robot.on('docked', print).off"];
    let names: Vec<&str> = names.split_whitespace().chain(methods).collect();
    let name = prop::sample::select(names);
    let value = prop::sample::select(vec![
        "nil",
        "true",
        "0",
        "-1",
        "1e308",
        "0/0",
        "math.huge",
        "''",
        "'left'",
        "'frame'",
        "{}",
        "{1, 2}",
        "print",
        "function() task.wait(0.1) return 1 end",
        "function() error({}) end",
        "buffer.create(4)",
        "coroutine.create(print)",
        "task.spawn(print)",
        "robot",
        "setmetatable({}, {__index = error, __tostring = error})",
        "vector.create(1, 2, 3)",
    ]);
    (name, prop::collection::vec(value, 0..4)).prop_map(|(name, values)| {
        format!(
            "print(pcall({name}{}))",
            values
                .iter()
                .map(|value| format!(", {value}"))
                .collect::<String>()
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_bytes_load_or_are_refused(source in prop::collection::vec(any::<u8>(), 0..300)) {
        run(&source);
    }

    #[test]
    fn any_text_loads_or_is_refused(source in ".{0,200}") {
        run(source.as_bytes());
    }

    #[test]
    fn any_words_run_or_fail(source in words()) {
        run(source.as_bytes());
    }

    #[test]
    fn any_arguments_are_answered(calls in prop::collection::vec(call(), 1..6)) {
        run(calls.join("\n").as_bytes());
    }
}
