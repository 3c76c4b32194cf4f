use super::*;
use crate::script::{Failure, MAX_SOURCE};
use proptest::prelude::*;

#[track_caller]
fn refused(source: &[u8]) -> Failure {
    let options = Options::new("test", "test.lua");
    Script::load(source, options, Instant::now()).unwrap_err()
}

#[test]
fn removed_globals_do_not_exist() {
    for name in [
        "io",
        "os",
        "debug",
        "package",
        "loadstring",
        "load",
        "dofile",
        "loadfile",
        "getfenv",
        "setfenv",
        "newproxy",
        "gcinfo",
    ] {
        let text = failure(&format!("\nlocal x = {name}"));
        assert!(
            text.starts_with(&format!("test.lua:2: unknown name '{name}'")),
            "{text}"
        );
    }
    let text = printed(
        "print(type(collectgarbage('count')))
         for _, what in {'collect', 'stop', 'step', 'restart', 'generational'} do print((pcall(collectgarbage, what))) end",
    );
    assert_eq!(text, "number\nfalse\nfalse\nfalse\nfalse\nfalse");
}

#[test]
fn libraries_and_the_api_are_read_only() {
    for source in [
        "string.find = 1",
        "math.pi = 3",
        "robot.move = print",
        "robot.mine = 1",
        "rawset(robot, 'move', 1)",
        "rawset(table, 'sort', 1)",
        "getmetatable('').__index = nil",
        "setmetatable(robot, {})",
        "setmetatable(_G, {})",
        "getmetatable(task.spawn(print)).x = 1",
    ] {
        let text = failure(source);
        assert!(text.starts_with("test.lua:1: "), "{source}: {text}");
    }
    assert_eq!(
        printed("robto = 5 function double(x) return x * 2 end print(double(robto), _G.robto)"),
        "10 5"
    );
}

#[test]
fn errors_of_beginners_name_the_line_and_the_remedy() {
    for (source, words) in [
        (
            "\nrobto.move(1, 2)",
            "test.lua:2: unknown name 'robto'; did you mean 'robot'?",
        ),
        (
            "\nprnt('x')",
            "test.lua:2: unknown name 'prnt'; did you mean 'print'?",
        ),
        (
            "sped = 5\n\nprint(speed)",
            "test.lua:3: unknown name 'speed'; did you mean 'sped'?",
        ),
        (
            "robot.moev(1, 2)",
            "test.lua:1: robot.moev does not exist; did you mean 'move'?",
        ),
        ("task.sleep(1)", "test.lua:1: task.sleep does not exist"),
        ("print(vison)", "unknown name 'vison'"),
        (
            "local t = task.spawn(print) t:cancl()",
            "test.lua:1: Task.cancl does not exist; did you mean 'cancel'?",
        ),
        (
            "local t = task.spawn(print) t.cancel()",
            "call it on a task with a colon, like task:cancel()",
        ),
        (
            "table.sort(nil)",
            "test.lua:1: table.sort: a list is expected, got nil",
        ),
        (
            "string.find(nil, 'x')",
            "test.lua:1: string.find: the text must be a string, got nil",
        ),
        ("('x'):rep({})", "test.lua:1: "),
        (
            "task.spawn(print())",
            "test.lua:1: task.spawn: the function is missing; it must be a function",
        ),
        (
            "task.spawn('x')",
            "the function must be a function, got 'x'",
        ),
        (
            "task.wait('1')",
            "test.lua:1: task.wait: seconds must be a number, got '1'",
        ),
        (
            "task.wait(-1)",
            "seconds must be between 0 and 2592000, got -1",
        ),
        ("error({code = 1})", "table"),
        ("error()", "nil"),
    ] {
        let text = failure(source);
        assert!(text.contains(words), "{source}: {text:?} lacks {words:?}");
        assert!(!text.contains("spykee:"), "{text}");
        assert!(!text.contains("traceback"), "{text}");
    }
}

#[test]
fn errors_are_plain_strings_for_pcall() {
    let text = printed(
        "local function show(...) local ok, e = pcall(...) print(ok, type(e), e) end
         show(robot.move, 140, 0)
         show(function() robot.move(140, 0) end)
         show(function() return robto end)
         show(function() return robot.moev end)
         local ok, e = xpcall(function() task.wait(-1) end, function(e) return 'handled ' .. e end) print(ok, e)",
    );
    assert_eq!(
        text.lines().collect::<Vec<_>>(),
        [
            "false string test.lua:1: robot.move: left must be between -100 and 100, got 140",
            "false string test.lua:3: robot.move: left must be between -100 and 100, got 140",
            "false string test.lua:4: unknown name 'robto'; did you mean 'robot'?",
            "false string test.lua:5: robot.moev does not exist; did you mean 'move'?",
            "false handled test.lua:6: task.wait: seconds must be between 0 and 2592000, got -1",
        ]
    );
}

#[test]
fn random_numbers_follow_the_seed() {
    let roll = |seed| {
        let source = "print(math.random(1, 1000000), math.random(), math.random(6))";
        let rig = Rig::with(source, |options| options.seed = seed);
        rig.texts().join("\n")
    };
    assert_eq!(roll(7), roll(7));
    assert_ne!(roll(7), roll(8));
    assert_ne!(roll(1), roll(1 << 40));
}

#[test]
fn bad_files_are_refused_with_their_line() {
    assert!(
        matches!(refused(&vec![b' '; MAX_SOURCE + 1]), Failure::TooLarge { bytes, .. } if bytes == MAX_SOURCE + 1)
    );
    assert!(matches!(
        refused(b"--\n--\n\xff\xfe"),
        Failure::NotUtf8 { line: 3, .. }
    ));
    let utf16: Vec<u8> = "\u{feff}print(1)"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    assert!(
        refused(&utf16)
            .to_string()
            .contains("save the file as UTF-8")
    );
    assert!(matches!(
        refused(b"--\n\x1b[2J"),
        Failure::Control {
            line: 2,
            byte: 0x1b,
            ..
        }
    ));
    let compiled = mlua::chunk::Compiler::new().compile("return 1").unwrap();
    assert!(matches!(
        refused(&compiled),
        Failure::Control { line: 1, .. }
    ));
    let text = refused(b"local x =\n\nif then").to_string();
    assert!(text.starts_with("test.lua:3: "), "{text}");
    assert!(
        refused(b"\xef\xbb\xbf)")
            .to_string()
            .starts_with("test.lua:1: ")
    );
    let largest = format!("--{}\nprint('big')", "x".repeat(MAX_SOURCE - 20));
    assert_eq!(printed(&largest), "big");
    assert_eq!(printed("\u{feff}print('bom')\r\n"), "bom");
}

#[test]
fn split_and_sort_do_what_luau_does() {
    let text = printed(
        "local function s(...) print(table.concat(string.split(...), '|')) end
         s('a,b,,c') s('a,b', ';') s('abc', '') s('', ',') s('a--b--', '--') s('x1y1z', 1) print(#(''):split(''))
         local t = {3, 1, 2} table.sort(t) print(table.concat(t, ' '))
         table.sort(t, function(a, b) return a > b end) print(table.concat(t, ' '))
         print(('hello'):find('l'), ('a.b'):gsub('%.', '-'), ('k=v'):match('(%w)=(%w)'))
         for w in ('one two'):gmatch('%a+') do print(w) end",
    );
    assert_eq!(
        text,
        "a|b||c\na,b\na|b|c\n\na|b|\nx|y|z\n0\n1 2 3\n3 2 1\n3 a-b k v\none\ntwo"
    );
}

#[test]
fn a_printed_table_shows_its_content_and_no_address() {
    let text = printed(
        "print({1, 2, {x = 'y'}}, 'and', {})
         local t = {} t.t = t print(t)
         print(setmetatable({}, {__tostring = function() return 'mine' end}))",
    );
    assert_eq!(text, "{1, 2, {x=y}} and {}\n{t={t={t={...}}}}\nmine");
}

fn session() -> Rig {
    Rig::with("", |options| {
        options.interactive = true;
        options.limits.callback_budget_ms = 2_000;
    })
}

impl Rig {
    /// Types a line that the next line may continue.
    fn types(&mut self, text: &str) {
        self.script.evaluate(text, true, self.now);
        self.run();
    }

    fn answer(&mut self, text: &str) -> Evaluated {
        self.types(text);
        self.answers.pop().expect("no answer")
    }
}

fn values(texts: &[&str]) -> Evaluated {
    Evaluated::Values(texts.iter().map(|&text| text.to_owned()).collect())
}

#[test]
fn a_session_persists_between_lines() {
    let mut rig = session();
    assert_eq!(rig.answer("x = 20"), values(&[]));
    rig.pass(1000.0);
    assert_eq!(rig.answer("x + 1, 'a'"), values(&["21", "\"a\""]));
    for line in [
        "local x = 30",
        "local y, z = x, 2",
        "local function twice(n)\n\treturn 2 * n\nend",
    ] {
        assert_eq!(rig.answer(line), values(&[]), "{line}");
    }
    assert_eq!(rig.answer("twice(x), y + z"), values(&["60", "32"]));
    assert_eq!(rig.script.ended(), None);
}

#[test]
fn an_incomplete_line_is_reported_as_such_and_a_wrong_one_is_not() {
    let mut rig = session();
    for begun in [
        "if true then",
        "function f()",
        "1 +",
        "x = {",
        "print(",
        "local x =",
        "local function f()",
    ] {
        assert_eq!(rig.answer(begun), Evaluated::Incomplete, "{begun}");
        rig.script.evaluate(begun, false, rig.now);
        rig.run();
        assert!(
            matches!(rig.answers.pop(), Some(Evaluated::Failed(_))),
            "{begun}"
        );
    }
    for wrong in ["then", "x y", ")", "robot.moev()", "1 + nil"] {
        assert!(matches!(rig.answer(wrong), Evaluated::Failed(_)), "{wrong}");
    }
}

#[test]
fn a_line_that_waits_has_its_result_when_it_is_done() {
    let mut rig = session();
    rig.types("task.wait(2) return 'late'");
    assert_eq!(rig.answers, []);
    rig.pass(3.0);
    assert_eq!(rig.answers, [values(&["\"late\""])]);
}

#[test]
fn a_setpoint_outlives_its_line_and_ends_with_an_interruption() {
    let mut rig = session();
    rig.deliver(connected(false));
    rig.types("robot.move(30, 30)");
    rig.pass(5.0);
    assert!(matches!(rig.take_intents()[..], [Intent::Move { .. }]));
    rig.script.interrupt(rig.now);
    rig.run();
    let intents = rig.take_intents();
    assert!(matches!(intents[0], Intent::Release { .. }), "{intents:?}");
    assert_eq!(intents.last(), Some(&Intent::Stop));
    assert!(!rig.script.has_motion());
}

#[test]
fn an_interruption_ends_the_line_the_tasks_and_the_handlers_and_keeps_the_variables() {
    let mut rig = session();
    rig.deliver(connected(false));
    rig.types("x = 1 task.every(0.5, function() robot.move(9, 9) end) robot.on('docked', print)");
    rig.types("task.wait(100)");
    rig.script.interrupt(rig.now);
    rig.run();
    assert_eq!(rig.answers.pop(), Some(Evaluated::Cancelled));
    rig.take_intents();
    rig.pass(10.0);
    rig.deliver(Event::Docked);
    assert_eq!((rig.take_intents(), rig.texts()), (vec![], vec![]));
    assert_eq!(rig.answer("x"), values(&["1"]));
}

#[test]
fn shown_values_are_bounded_and_run_no_line_of_the_script() {
    let mut rig = session();
    let Evaluated::Values(shown) = rig.answer(
        "(function() local t = setmetatable({}, {
            __tostring = function() error('run') end,
            __iter = function() error('run') end,
            __index = function() error('run') end })
         for i = 1, 100000 do t[i] = string.rep('x', 30) end
         return t, string.rep('\\27[2J', 100000), t end)()",
    ) else {
        panic!("it failed");
    };
    assert_eq!(shown.len(), 3);
    assert!(
        shown
            .iter()
            .all(|text| text.len() < 1000 && !text.contains('\x1b')),
        "{shown:?}"
    );
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in ".{0,60}", more in any::<bool>()) {
        let mut rig = session();
        rig.script.evaluate(&text, more, rig.now);
        rig.run();
        prop_assert!(rig.script.ended().is_some() || !rig.answers.is_empty() || rig.script.next_deadline().is_some());
    }
}
