//! Scripts that try to run forever, to use all memory, or to drive after their end. The time bounds
//! are generous, since without the guards the scripts would not end at all.

use std::time::Instant as RealTime;

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
fn pcall_cannot_end_a_kill() {
    for source in [
        "while true do pcall(function() while true do end end) robot.move(9, 9) end",
        "local function f() while true do pcall(f) end end f()",
        "local function again() pcall(again) while true do pcall(again) end end again()",
        "while true do xpcall(function() while true do end end, function() while true do end end) end",
        "local co = coroutine.wrap(function() while true do pcall(function() while true do end end) end end) while true do pcall(co) end",
        "while true do coroutine.resume(coroutine.create(function() while true do end end)) end",
        "while true do pcall(coroutine.yield) end",
        "setmetatable({}, {__index = function() while true do end end}).x = 1 local t = setmetatable({}, {__index = function() while true do end end}) while true do pcall(function() return t.x end) end",
        "error(setmetatable({}, {__tostring = function() while true do end end}))",
        "print(setmetatable({}, {__tostring = function() while true do end end}))",
    ] {
        ends_with(EndReason::Cpu, source);
    }
}

#[test]
fn a_cancelled_task_cannot_continue() {
    let rig = ends(
        "local t = task.spawn(function()
             while true do pcall(function() while true do pcall(task.wait) robot.move(9, 9) end end) end
         end)
         task.wait(0.1) t:cancel()",
    );
    rig.assert_ended(EndReason::Done, "");
    ends_with(
        EndReason::Cpu,
        "local t = task.spawn(function() pcall(task.wait, 9) while true do pcall(function() end) end end)
         task.wait(0.1) t:cancel()",
    );
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
fn sorting_is_interrupted() {
    for source in [
        "local t = {} local s = ('a'):rep(1000) for i = 1, 4000 do t[i] = s .. i end while true do table.sort(t) end",
        "local t = {} for i = 1, 1e5 do t[i] = i end while true do table.sort(t, function(a, b) return true end) end",
    ] {
        let rig = ends(source);
        assert!(matches!(
            rig.exit().reason,
            EndReason::Cpu | EndReason::Error
        ));
    }
}

#[test]
fn loops_of_library_functions_alone_are_interrupted() {
    for source in [
        "local t = table.create(200000, 1) table.sort(table.create(200000, t), table.find)",
        "local k = {} for _ = 1, 40 do k = {[k] = table.foreach, [table.clone(k)] = table.foreach} end table.foreach(k, table.foreach)",
        "local l = table.create(100000, 'x') while true do pcall(table.foreachi, table.create(100000, ' '), string.rep) end",
        "local m = {__eq = table.find} local function n() local a = setmetatable({}, m) for _ = 1, 20 do a = setmetatable(table.create(10, a), m) end return a end table.find(n(), n())",
        "local s = ('x'):rep(1e6) while true do s:gsub('x', string.upper) end",
        "while true do xpcall(error, table.concat, {}) end",
    ] {
        ends_with(EndReason::Cpu, source);
    }
    for last in [
        "local t = table.create(200000, 1) table.sort(table.create(200000, t), table.find)",
        "local k = {} for _ = 1, 40 do k = {[k] = table.foreach, [table.clone(k)] = table.foreach} end table.foreach(k, table.foreach)",
    ] {
        ends_with(
            EndReason::Done,
            &format!("script.on_stop(function() {last} end)"),
        );
    }
}

#[test]
fn hash_flooding_is_interrupted_or_runs_out_of_memory() {
    let rig = ends(
        "local parts = {} for i = 1, 100000 do parts[i] = ('%08d'):format(i):rep(4) end
         while true do local all = table.concat(parts, ','):split(',') end",
    );
    assert!(matches!(
        rig.exit().reason,
        EndReason::Cpu | EndReason::Memory
    ));
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
        rig.assert_ended(
            EndReason::Memory,
            "of the 8192 KiB".trim_start_matches("of the "),
        );
        assert!(rig.script.usage().memory_bytes < 10 * 1024 * 1024);
    }
}

#[test]
fn a_swallowed_memory_error_stays_within_the_limit() {
    let rig = ends(
        "local keep = {} while true do pcall(function() while true do keep[#keep + 1] = ('x'):rep(100000) .. #keep end end) end",
    );
    assert!(matches!(
        rig.exit().reason,
        EndReason::Cpu | EndReason::Memory
    ));
    assert!(rig.script.usage().memory_bytes < 10 * 1024 * 1024);
}

#[test]
fn deep_recursion_is_an_error_not_a_crash() {
    for source in [
        "local function f() return 1 + f() end f()",
        "local t = setmetatable({}, {}) getmetatable(t).__index = function(_, k) return t[k] end return t.x",
        "local function f(n) return coroutine.wrap(f)(n + 1) end f(1)",
        "local function f() return (('x'):gsub('x', f)) end f()",
        "local function f() table.sort({1, 2, 3}, f) end f()",
        "local s = {} for i = 1, 50000 do s = {s} end print(s) log.info('x', {s = s}) error('deep')",
    ] {
        let rig = ends(source);
        assert!(
            matches!(
                rig.exit().reason,
                EndReason::Error | EndReason::Memory | EndReason::Cpu
            ),
            "{source}: {:?}",
            rig.exit()
        );
    }
}

#[test]
fn failing_calls_do_not_grow_memory_outside_the_vm() {
    let rig = ends(
        "local keep, long = {}, ('x'):rep(100000)
         while true do
             local _, e = pcall(robot.play, long) keep[#keep + 1] = e
             assert(#e < 500)
         end",
    );
    assert!(matches!(
        rig.exit().reason,
        EndReason::Cpu | EndReason::Memory
    ));
}

#[test]
fn rethrown_errors_stay_flat() {
    ends(
        "local function f(n) local ok, e = pcall(function() if n > 0 then f(n - 1) else robot.move('x') end end) error(e) end
         for _ = 1, 1000 do pcall(f, 50) end",
    );
}

#[test]
fn table_move_has_its_timeout_fix() {
    // The flag may disappear in a later Luau: then this call must be quick without it.
    let began = RealTime::now();
    ends("pcall(table.move, {}, 1, 2e9, -2e9, {})");
    assert!(began.elapsed() < Duration::from_secs(4));
}

#[test]
fn log_output_is_bounded() {
    let rig = ends("while true do print(('x'):rep(1000)) end");
    assert_eq!(rig.exit().reason, EndReason::Cpu);
    assert!(rig.log.len() < 110);
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
