use super::*;

#[test]
fn easy_is_tolerant_and_its_errors_are_for_beginners() {
    let mut rig = Rig::new(
        "local easy = require('@spykee/easy') easy.light('on') easy.light('left', 'off') print(easy.forward('2', 40))",
    );
    let intents = rig.take_intents();
    assert_eq!(intents.len(), 5, "{intents:?}");
    rig.deliver(motion_ended(&intents[4], MotionEnd::Done));
    assert_eq!(rig.texts(), ["true"]);
    for (line, words) in [
        (
            "easy.forward('fast')",
            "easy.forward: how many seconds? A number is needed, such as 1",
        ),
        (
            "easy.forward(1, 500)",
            "what speed? It must be from 1 to 100, got 500",
        ),
        (
            "easy.drive(5000)",
            "how many centimetres? It must be from -1000 to 1000, got 5000",
        ),
        ("easy.light('left', 'maybe')", "on or off?"),
        ("easy.light('lfet')", "easy.light: unknown light 'lfet'"),
        ("easy.light(nil)", "easy.light: light is missing"),
        ("easy.sound('lauhg')", "easy.sound: unknown sound 'lauhg'"),
        (
            "table.sort({ 1, 2 }, function() easy.forward(1) return true end)",
            "easy.forward: nothing can wait here",
        ),
        (
            "table.sort({ 1, 2 }, function() easy.wait(1) return true end)",
            "easy.wait: nothing can wait here",
        ),
        (
            "table.sort({ 1, 2 }, function() easy.go_home() return true end)",
            "easy.go_home: nothing can wait here",
        ),
        (
            "easy.foward(1)",
            "easy.foward does not exist; did you mean 'forward'?",
        ),
    ] {
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
