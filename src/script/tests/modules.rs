use super::*;

fn run(source: &str, files: &[(&str, &str)]) -> Rig {
    let mut rig = Rig::new(source);
    rig.serve(files);
    rig
}

#[test]
fn a_module_runs_once_and_returns_its_value() {
    let rig = run(
        "local a = require('./lib/a') local b = require('./lib/a.lua') print(a == b, a.x)
         local path = './' .. 'b' print(require(path), (function() return require('./b') end)())",
        &[
            (
                "lib/a.luau",
                "print('a runs') return { x = require('../b') }",
            ),
            ("b.lua", "task.wait(0) return 7"),
        ],
    );
    let mut rig = rig;
    rig.pass(1.0);
    rig.serve(&[("b.lua", "task.wait(0) return 7")]);
    rig.pass(1.0);
    assert_eq!(rig.texts(), ["a runs", "true 7", "7 7"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn a_module_has_its_own_globals_and_cannot_change_shared_ones() {
    let rig = run(
        "x = 1 print(require('./a'), x, y == nil)",
        &[(
            "a.lua",
            "y = 2 print(pcall(function() return x end)) print(pcall(function() robot.x = 1 end)) return _G.y",
        )],
    );
    let texts = rig.texts();
    assert!(
        texts[0].contains("false a.lua:1: unknown name 'x'"),
        "{texts:?}"
    );
    assert!(
        texts[1].starts_with("false a.lua:1: robot.x cannot be set"),
        "{texts:?}"
    );
    let exit = rig.exit();
    assert!(exit.message.unwrap().contains("unknown name 'y'"));
}

#[test]
fn an_error_in_a_module_has_its_file_and_line_and_stays() {
    for (source, words) in [
        ("\nerror('oops')", "lib/a.lua:2: oops"),
        ("\nlocal = 3", "lib/a.lua:2: "),
        (
            "\nrobot.moev()",
            "lib/a.lua:2: robot.moev does not exist; did you mean 'move'?",
        ),
        (
            "local x = 1",
            "test.lua:1: require: lib/a: a module must end with return",
        ),
        ("\u{1b}Lua", "lib/a.lua:1: control character 0x1b"),
    ] {
        let rig = run(
            "local ok, e = pcall(require, './lib/a') print(e) print(select(2, pcall(require, './lib/a')))",
            &[("lib/a.lua", source)],
        );
        let texts = rig.texts();
        assert!(texts[0].starts_with(words), "{texts:?}");
        assert!(
            texts[1].ends_with(texts[0].trim_start_matches("test.lua:1: require: ")),
            "{texts:?}"
        );
        assert!(rig.modules.is_empty());
    }
}

#[test]
fn a_cycle_names_its_chain() {
    let rig = run(
        "require('./a')",
        &[
            ("a.lua", "return require('./b')"),
            ("b.lua", "return require('./c')"),
            ("c.lua", "return require('./a')"),
        ],
    );
    rig.assert_ended(EndReason::Error, "a.lua -> b.lua -> c.lua -> a.lua");
    run("require('./test')", &[]).assert_ended(EndReason::Error, "test.lua -> test.lua");
    run("require('./a')", &[("a.lua", "return require('./a')")])
        .assert_ended(EndReason::Error, "a.lua -> a.lua");
}

#[test]
fn two_tasks_that_require_each_others_modules_do_not_wait_forever() {
    let mut rig = run(
        "task.spawn(function() print(pcall(require, './a')) end)
         task.spawn(function() print(pcall(require, './b')) end)",
        &[
            ("a.lua", "task.wait(0.1) return { require('./b') }"),
            ("b.lua", "task.wait(0.1) return { require('./a') }"),
        ],
    );
    rig.pass(1.0);
    rig.assert_ended(EndReason::Done, "");
    assert!(
        rig.texts()
            .iter()
            .any(|text| text.contains("a.lua -> b.lua -> a.lua")
                || text.contains("b.lua -> a.lua -> b.lua")),
        "{:?}",
        rig.texts()
    );
}

#[test]
fn a_module_that_is_being_loaded_is_waited_for() {
    let mut rig = run(
        "for _ = 1, 3 do task.spawn(function() print(require('./slow')) end) end",
        &[("slow.lua", "print('once') task.wait(1) return 'slow'")],
    );
    rig.pass(2.0);
    assert_eq!(rig.texts(), ["once", "slow", "slow", "slow"]);
}

#[test]
fn a_cancelled_load_is_started_again() {
    let files = [("slow.lua", "print('runs') task.wait(5) return 'slow'")];
    let mut rig = run(
        "local t = task.spawn(function() require('./slow') end)
         task.wait(1) t:cancel() print(require('./slow'))",
        &files,
    );
    rig.pass(1.0);
    rig.pass(9.0);
    assert_eq!(rig.texts(), ["runs", "runs", "slow"]);
}

#[test]
fn invalid_paths_are_reported() {
    for (source, words) in cases(
        r"require('pid') => a path begins with ./ or ../
          require('../x') => leaves the behaviour's folder
          require('/etc/passwd') => a path begins with
          require(42) => the path must be a string
          require('./' .. ('x'):rep(1e6)) => too long: at most 200 bytes
          require('./\xff') => must be UTF-8
          require('@spykee/fms') => did you mean '@spykee/fsm'?
          require('./nowhere') => test.lua:1: require: module 'nowhere' was not found",
    ) {
        let rig = run(source, &[]);
        rig.assert_ended(EndReason::Error, words);
    }
}

#[test]
fn modules_are_bounded_in_number_and_size() {
    let mut rig = Rig::new("for i = 1, 200 do pcall(require, './m' .. i) end require('./last')");
    for _ in 0..20 {
        rig.serve(&[]);
        rig.pass(0.01);
    }
    rig.assert_ended(EndReason::Error, "at most 128 modules");
    let big = format!("return '{}'", "x".repeat(250_000));
    let mut rig = Rig::new("for i = 1, 9 do require('./m' .. i) end");
    let files: Vec<String> = (1..9).map(|at| format!("m{at}.lua")).collect();
    let files: Vec<(&str, &str)> = files.iter().map(|file| (&**file, &*big)).collect();
    rig.serve(&files);
    rig.assert_ended(EndReason::Error, "(1 MiB) in total");
}

#[test]
fn a_module_that_never_ends_loading_ends_the_script() {
    let mut rig = Rig::with(
        "robot.move(50, 50) pcall(require, './loop') robot.move(90, 90)",
        |_| {},
    );
    rig.serve(&[("loop.lua", "while true do pcall(function() end) end")]);
    rig.assert_ended(EndReason::Cpu, "loop.lua:1: ran longer than 100 ms");
    assert!(!rig.script.has_motion());
}

#[test]
fn a_module_that_yields_gets_an_error_and_one_suspended_while_loading_is_reported() {
    let rig = run(
        "print(pcall(require, './y'))",
        &[("y.lua", "coroutine.yield(1) return 1")],
    );
    assert!(
        rig.texts()[0].contains("there is nothing to yield to"),
        "{:?}",
        rig.texts()
    );
    let rig = run(
        "local co = coroutine.create(function() return require('./y') end)
         coroutine.resume(co) print(pcall(require, './y'))",
        &[("y.lua", "coroutine.yield(1) return 1")],
    );
    assert!(
        rig.texts()[0].contains("still being loaded by this very task"),
        "{:?}",
        rig.texts()
    );
}

#[test]
fn easy_is_tolerant_and_its_errors_are_for_beginners() {
    let mut rig = Rig::new(
        "local easy = require('@spykee/easy') easy.light('on') easy.light('left', 'off') print(easy.forward('2', 40))",
    );
    let intents = rig.take_intents();
    assert_eq!(intents.len(), 5, "{intents:?}");
    rig.deliver(motion_ended(&intents[4], MotionEnd::Done));
    assert_eq!(rig.texts(), ["true"]);
    for (line, words) in cases(
        "easy.forward('fast') => easy.forward: how many seconds? A number is needed, such as 1
         easy.forward(1, 500) => what speed? It must be from 1 to 100, got 500
         easy.drive(5000) => how many centimetres? It must be from -1000 to 1000, got 5000
         easy.light('left', 'maybe') => on or off?
         easy.light('lfet') => easy.light: unknown light 'lfet'
         easy.light(nil) => easy.light: light is missing
         easy.sound('lauhg') => easy.sound: unknown sound 'lauhg'
         table.sort({ 1, 2 }, function() easy.forward(1) return true end) => easy.forward: nothing can wait here
         table.sort({ 1, 2 }, function() easy.wait(1) return true end) => easy.wait: nothing can wait here
         table.sort({ 1, 2 }, function() easy.go_home() return true end) => easy.go_home: nothing can wait here
         easy.foward(1) => easy.foward does not exist; did you mean 'forward'?",
    ) {
        let text = failure(&format!("local easy = require('@spykee/easy')\n{line}"));
        assert!(
            text.starts_with("test.lua:2: ") && text.contains(words),
            "{text}"
        );
    }
}

#[test]
fn errors_of_modules_name_the_call_that_the_author_wrote() {
    let machine = "require('@spykee/fsm').new({ initial = 'a', states = { a = {} } })";
    let pid = "require('@spykee/pid').new({})";
    let sorted = "table.sort({ 1, 2 }, function() CALL return true end)";
    let bt = "local bt = require('@spykee/bt') local function yes() return true end";
    let full = "for _ = 1, 300 do pcall(task.spawn, function() task.wait(9) end) end";
    for (line, words) in [
        (
            format!("{machine}.run()"),
            "machine:run: must be called with a colon",
        ),
        (
            format!("{machine}.go('a')"),
            "machine:go: must be called with a colon",
        ),
        (
            format!("{machine}.stop(1)"),
            "machine:stop: must be called with a colon: machine:stop()",
        ),
        (
            format!("{machine}.go(require('@spykee/fsm'))"),
            "machine:go: must be called with a colon: machine:go(\"STATE\"), with the name of a state",
        ),
        (
            format!("{machine}.run(require('@spykee/fsm'))"),
            "machine:run: must be called with a colon: machine:run()",
        ),
        (
            machine.replace(
                "a = {}",
                "a = { enter = function(m) m:go(require('@spykee/fsm')) end }",
            ) + ":run()",
            "machine:go: the name of a state is needed, got table (states: a)",
        ),
        (
            format!(
                "{bt} local many = table.create(300, yes) bt.run(bt.parallel({{}}, table.unpack(many)))"
            ),
            "bt.parallel: 1 of at most 256 tasks are running already, and it needs 300 more",
        ),
        (
            format!("{bt} {full} bt.run(bt.guard(yes, yes))"),
            "bt.guard: 256 of at most 256 tasks are running already, and it needs 2 more",
        ),
        (
            format!("{bt} {full} bt.run(bt.timeout(1, yes))"),
            "bt.timeout: 256 of at most 256 tasks are running already, and it needs 1 more",
        ),
        (
            format!("{pid}.update(1)"),
            "controller:update: must be called with a colon",
        ),
        (
            format!("{pid}.reset()"),
            "controller:reset: must be called with a colon",
        ),
        (
            format!("local m = {machine} {}", sorted.replace("CALL", "m:run()")),
            "machine:run: nothing can wait here",
        ),
        (
            machine.replace("a = {}", "a = { timeout = { 1e9, 'a' } }"),
            "fsm.new: state a: timeout must be {seconds, \"state\"}, with 0 to 2592000 seconds",
        ),
        (
            format!("{bt} bt.timeout(1e9, yes)"),
            "bt.timeout: the seconds must be a number between 0 and 2592000, got 1000000000",
        ),
        (
            format!("{bt} bt.guard(yes, yes, 1e9)"),
            "bt.guard: the seconds must be a number above 0 and at most 2592000",
        ),
        (
            format!(
                "{bt} {}",
                sorted.replace("CALL", "bt.run(bt.timeout(1, yes))")
            ),
            "bt.timeout: nothing can wait here",
        ),
        (
            format!(
                "{bt} {}",
                sorted.replace("CALL", "bt.run(bt.parallel({}, yes))")
            ),
            "bt.parallel: nothing can wait here",
        ),
    ] {
        let text = failure(&line);
        assert!(
            text.starts_with("test.lua:1: ") && text.contains(words),
            "{text}"
        );
    }
}
