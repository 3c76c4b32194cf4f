use super::*;
use crate::script::{Failure, MAX_SOURCE};

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
            .replace("3 a-b k v", "3 3 a-b 1 k v")
            .replace("3 3 a-b 1 k v", "3 a-b k v")
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
