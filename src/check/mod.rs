//! Checks a script before it runs, and explains the VM's error of a failed one in plain words.
//! There are no false positives: what the file alone cannot show is left to the run. The work is
//! bounded whatever the file contains, and no part of the script runs.

mod diagnostic;
mod explain;
mod kinds;
mod lexer;
mod parser;
mod passing;
mod required;
mod syntax;
mod tree;
mod walk;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use tokio::time::Instant;

use crate::api;
use crate::robot::Streams;
use crate::script::{Failure, GivenParam, Options, Script, compile_error, read_text, resolve};

use diagnostic::SourceText;
pub use diagnostic::{Diagnostic, Severity};
pub use explain::{explain, explanation};
use lexer::Span;
pub use required::{Required, required};

#[derive(Debug, Clone)]
pub struct CheckContext {
    /// Every path (such as `robot.move`) that exists in a live VM.
    paths: BTreeSet<String>,
    colours: Vec<String>,
    /// The script's file; relative module paths start from its folder.
    file: Option<PathBuf>,
    /// Accept every global: there is no VM that knows them.
    open_globals: bool,
    params: BTreeMap<String, GivenParam>,
    streams: Streams,
}

impl CheckContext {
    pub fn new(options: &Options, file: Option<&Path>) -> CheckContext {
        let script = if file.is_some_and(is_scenario) {
            Script::empty_scenario(options.clone(), Instant::now())
        } else {
            Script::load(b"", options.clone(), Instant::now())
        };
        CheckContext {
            paths: script
                .map(|script| script.known_names())
                .unwrap_or_default(),
            colours: options.colours.keys().cloned().collect(),
            file: file.map(Path::to_path_buf),
            open_globals: false,
            params: options.params.clone(),
            streams: options.streams,
        }
    }

    fn defined() -> CheckContext {
        let functions = api::functions();
        let constants = api::constants().map(|one| one.path.to_owned());
        CheckContext {
            paths: functions
                .map(|one| one.path.to_owned())
                .chain(constants)
                .collect(),
            colours: Vec::new(),
            file: None,
            open_globals: true,
            params: BTreeMap::new(),
            streams: Streams::default(),
        }
    }

    /// Returns why there is no such module; `None` if there may be one.
    fn missing_module(&self, path: &str) -> Option<String> {
        let beside = path.starts_with("./") || path.starts_with("../");
        if !beside {
            return resolve("", path).err();
        }
        let folder = self.file.as_ref()?.parent()?;
        let path = path.trim_end_matches(".luau").trim_end_matches(".lua");
        let found = ["lua", "luau"]
            .iter()
            .any(|ending| may_be_file(&folder.join(format!("{path}.{ending}"))));
        if found {
            return None;
        }
        Some(format!(
            "there is no module '{path}': no file {path}.lua beside this one"
        ))
    }
}

/// True also if permission is denied: this process may have fewer rights than its user.
fn may_be_file(path: &Path) -> bool {
    match path.metadata() {
        Ok(metadata) => metadata.is_file(),
        Err(error) => error.kind() == std::io::ErrorKind::PermissionDenied,
    }
}

/// Returns the errors that prevent a script with these options from running, without the warnings.
/// The options' chunk name is the script's file.
pub fn errors(source: &[u8], options: &Options) -> Vec<Diagnostic> {
    let context = CheckContext::new(options, Some(Path::new(&options.chunk)));
    let mut diagnostics = check(source, &options.chunk, &context);
    diagnostics.retain(|diagnostic| diagnostic.severity == Severity::Error);
    diagnostics
}

/// `*_test.lua`, or the `check.lua` of a lesson.
fn is_scenario(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    name.ends_with("_test.lua") || name == "check.lua"
}

/// Returns everything wrong with a script that can be detected without running it.
pub fn check(source: &[u8], chunk: &str, context: &CheckContext) -> Vec<Diagnostic> {
    let text = match read_text(source, chunk) {
        Ok(text) => text,
        Err(failure) => return vec![unreadable(source, chunk, &failure)],
    };
    let source = SourceText { file: chunk, text };
    if let Some(complaint) = compile_error(text, chunk) {
        return vec![syntax::diagnostic(source, &complaint)];
    }
    match parser::parse(text) {
        Ok(tree) => walk::walk(&tree, source, context),
        Err(_) => Vec::new(),
    }
}

fn unreadable(source: &[u8], chunk: &str, failure: &Failure) -> Diagnostic {
    let text = String::from_utf8_lossy(source);
    let line = match failure {
        Failure::NotUtf8 { line, .. } | Failure::Control { line, .. } => *line,
        _ => 1,
    };
    let start: usize = text
        .split_inclusive('\n')
        .take(line - 1)
        .map(str::len)
        .sum();
    let span = Span { start, end: start };
    let words = failure.to_string();
    let words = words.strip_prefix(chunk).unwrap_or(&words);
    let words = words.trim_start_matches(|c: char| c == ':' || c == ' ' || c.is_ascii_digit());
    let source = SourceText {
        file: chunk,
        text: &text,
    };
    source.error(span, words)
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use proptest::prelude::*;

    use super::{CheckContext, Diagnostic, Severity, check, explain, parser};
    use crate::api;
    use crate::robot::{Streams, Use};
    use crate::script::Options;
    use crate::script::tests::failure_with;

    fn context() -> CheckContext {
        CheckContext::new(&Options::new("test", "test.lua"), None)
    }

    fn checked(source: &[u8]) -> Vec<Diagnostic> {
        check(source, "test.lua", &context())
    }

    fn errors(source: &str) -> Vec<String> {
        let diagnostics = checked(source.as_bytes()).into_iter();
        let errors = diagnostics.filter(|diagnostic| diagnostic.severity == Severity::Error);
        errors.map(|diagnostic| diagnostic.message).collect()
    }

    #[test]
    fn use_of_a_stream_that_the_config_keeps_off_is_a_warning() {
        let options = Options {
            streams: Streams {
                video: Use::Off,
                ..Streams::default()
            },
            ..Options::new("test", "test.lua")
        };
        let context = CheckContext::new(&options, None);
        let warned = |source: &str| {
            let found = check(source.as_bytes(), "test.lua", &context);
            let [diagnostic] = found.as_slice() else {
                assert!(found.is_empty(), "{found:?}");
                return false;
            };
            assert_eq!(diagnostic.severity, Severity::Warning);
            assert!(
                diagnostic.message.contains("the config keeps video off"),
                "{diagnostic:?}"
            );
            true
        };
        for source in [
            "robot.on('frame', print)",
            "robot.wait_for('frame', 3)",
            "robot.once('frame', print)",
            "robot.stream('video', true)",
            "print(robot.frame())",
            "print(robot.wait_frame(3))",
        ] {
            assert!(warned(source), "{source}");
            assert_eq!(checked(source.as_bytes()), [], "{source}");
        }
        for source in [
            "robot.on('noise', print)",
            "robot.stream('audio_in', true)",
            "robot.stream('video', false)",
            "local function switch(name) robot.stream(name, true) end switch('video')",
        ] {
            assert!(!warned(source), "{source}");
        }
    }

    fn scripts(folder: &str) -> Vec<(PathBuf, Vec<u8>)> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        let files = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let scripts =
            files.filter(|path| path.extension().is_some_and(|extension| extension == "lua"));
        scripts
            .map(|path| (path.clone(), std::fs::read(&path).unwrap()))
            .collect()
    }

    /// Reads the expectation of a script in the corpus: who reports the error, its line and its
    /// words.
    fn promise(source: &str) -> (String, u32, String) {
        let line = source
            .lines()
            .find_map(|line| line.strip_prefix("-- expect: "))
            .unwrap();
        let (place, words) = line.split_once(": ").unwrap();
        let (by, line) = place.split_once(' ').unwrap();
        (by.to_owned(), line.parse().unwrap(), words.to_owned())
    }

    #[test]
    fn each_broken_script_gets_the_message_that_it_expects() {
        let corpus = scripts("tests/broken");
        assert!(corpus.len() >= 70, "{}", corpus.len());
        let mut wrong = Vec::new();
        for (path, source) in corpus {
            let text = String::from_utf8(source.clone()).unwrap();
            let (by, line, words) = promise(&text);
            let mut helps = text
                .lines()
                .filter_map(|line| line.strip_prefix("-- help: "));
            let help = helps.next().unwrap_or_default();
            let diagnostics = checked(&source);
            let shown: Vec<String> = match by.as_str() {
                "check" => diagnostics
                    .iter()
                    .map(|one| {
                        let help = one.help.as_deref().unwrap_or_default();
                        format!("{}: {}\n{help}", one.line, one.message)
                    })
                    .collect(),
                _ => {
                    let errors = diagnostics
                        .iter()
                        .filter(|one| one.severity == Severity::Error);
                    wrong.extend(
                        errors.map(|one| format!("{}: not by check: {one}", path.display())),
                    );
                    vec![failure_with(&text, explain).replacen("test.lua:", "", 1)]
                }
            };
            let kept = shown.iter().any(|one| {
                let begins = one.starts_with(&format!("{line}: "));
                begins && one.contains(&words) && one.contains(help)
            });
            if !kept {
                wrong.push(format!(
                    "{}: {line}: {words:?}, but {shown:#?}",
                    path.display()
                ));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    #[test]
    fn an_if_without_its_end_is_explained_with_its_else() {
        let source = "if robot.docked() then\n\tif robot.charging() then\n\t\tprint(1)\nelse\n\tprint(2)\nend\n";
        for (source, help) in [
            (
                source.to_owned(),
                "without it, the `else` on line 4 belongs to this if",
            ),
            (
                source.replace("else\n", "\telse\n"),
                "one end closes the whole if, after its `else` on line 4",
            ),
            (
                source.replace("else\n", "\t\tprint(2)\n"),
                "each function, if, for, while and do is closed by its own end",
            ),
        ] {
            let found = checked(source.as_bytes());
            let helps: Vec<_> = found.iter().map(|one| one.help.as_deref()).collect();
            assert_eq!(helps, [Some(help)], "{source}");
        }
    }

    #[test]
    fn correct_scripts_have_no_diagnostics() {
        for (path, source) in scripts("behaviours") {
            let context = CheckContext::new(&Options::new("test", "test.lua"), Some(&path));
            let found = check(&source, "test.lua", &context);
            assert_eq!(found, [], "{}", path.display());
        }
        let of_behaviours =
            api::namespaces().filter(|one| one.availability != api::Availability::Scenario);
        let functions = of_behaviours
            .chain(api::modules())
            .flat_map(|one| one.functions);
        let methods = api::methods().filter(|one| one.owner() != "sim");
        let functions = functions.chain(methods).map(|one| (one.path, one.example));
        let constants = api::constants().map(|one| (one.path, one.example));
        for (path, example) in functions.chain(constants) {
            assert_eq!(checked(example.as_bytes()), [], "{path}: {example}");
        }
    }

    #[test]
    fn unusual_but_correct_scripts_have_no_diagnostics() {
        for source in [
            "local t = { n = 1 } t.x, t['y'] = 1, 2 for k, v in t do print(k, v) end",
            "local function f(...) local a, b = ... return select('#', ...), a, b end print(f(1, 2))",
            "type Point = { x: number, y: number? } local p: Point = { x = 1 } print(p.x :: any)",
            "export type F = (a: number, ...string) -> (number, string) local f: F? = nil print(f)",
            "local function id<T>(x: T): T return x end print(id(5))",
            "robot.on('frame', function(f: any) f:find_blobs('red') local n = f.age print(n) end)",
            "for i = 1, 3 do if i == 2 then continue end print(i) end",
            "local x = if true then 1 else 2 x += 1 x ..= 'a' print(x)",
            "print(`a{1}b{ ({2})[1] }c{`d{3}`}`)",
            "local s = [==[ a ]] b ]==] --[[ long\ncomment ]] print(s, 0xff, 0b11, 1_000, 1e-3, .5)",
            "local blob = robot.wait_frame(1):find_blobs({ 'red', vision.hsv{ h = { 1, 2 } } })[1] blob.mine = 1 print(blob.mine)",
            "global = 1 function other() return global end print(other(), _G.global)",
            "local ok, why = robot.move(10, 10, 1) print(ok and why or 'x')",
            "local power = 140 power = 40 robot.move(power, power)",
            "local function go(speed) robot.move(speed, speed) end go(5)",
            "robot.move(table.unpack({ 1, 2 }))",
            "task.spawn(robot.move, 10, 10) task.delay(1, print, 'x', 2)",
            "while true do if robot.docked() then break end robot.move(10, 10) task.wait(1) end",
            "local function step() task.wait(1) end while true do step() end",
            "while true do coroutine.yield() end",
            "local co = coroutine.wrap(function() while true do coroutine.yield(1) end end) print(co())",
            "robot.once('battery', function(b) print(b.percent + 1, b.charging) end)",
            "local e = robot.wait_for('safety', 5) if e then print(e.action .. e.reason) end",
            "local t = setmetatable({}, { __call = function() return 1 end }) print(t())",
            "local mine = {} function mine.go(self) return self end function mine:stop() return self end mine:stop():go()",
            "log.info('x', { a = 1 }) log.warn(5) print()",
            "robot.on('noise', print, { rate = 2, queue = 'all' }):off()",
            "local t = task.every(1, print) t:cancel() print(t.status, t.missed, t:join(1))",
            "local frame = robot.frame() local roi = { x = 1, y = 2, w = 3, h = 4 } print(frame and frame:brightness(roi))",
            "local o = { timeout = 3 } robot.dock(o) o.timeout = 5 robot.dock(o) robot.dock()",
            "return 1",
            "do local robot = nil print(robot) end",
            "print(#arg_list()) function arg_list() return {} end",
            "@native local function f() end f()",
        ] {
            assert_eq!(errors(source), [""; 0], "{source}");
        }
    }

    #[test]
    fn every_script_that_compiles_can_be_parsed() {
        for folder in ["behaviours", "tests/hostile", "tests/broken"] {
            for (path, source) in scripts(folder) {
                let Ok(text) = String::from_utf8(source.clone()) else {
                    continue;
                };
                let name = path.file_stem().unwrap().to_str().unwrap();
                let chunk = mlua::Lua::new();
                let chunk = chunk.load(&text).set_mode(mlua::chunk::ChunkMode::Text);
                let compiles = chunk.into_function().is_ok();
                let deep = ["nested_parentheses", "nested_functions"].contains(&name);
                assert!(
                    !compiles || deep || parser::parse(text.trim_start_matches('\u{feff}')).is_ok(),
                    "{}",
                    path.display()
                );
            }
        }
    }

    #[test]
    fn hostile_scripts_are_checked_within_bounds() {
        for (path, source) in scripts("tests/hostile") {
            let began = std::time::Instant::now();
            let _ = checked(&source);
            let took = began.elapsed();
            assert!(took.as_secs() < 5, "{}: {took:?}", path.display());
        }
        let deep = [
            "(",
            "{",
            "function() ",
            "if x then ",
            "a.",
            "not ",
            "-",
            "`{",
            "x..",
            "a[",
            "f(",
            "::",
            "do ",
        ];
        for piece in deep {
            let _ = checked(piece.repeat(60_000 / piece.len()).as_bytes());
            let _ = checked(format!("x = {}", piece.repeat(20_000 / piece.len())).as_bytes());
        }
    }

    /// Fragments of scripts, valid and invalid.
    fn fragments() -> Vec<&'static str> {
        let words = r#"
        local function end if then else elseif while do for in repeat until return break
        continue and or not nil true false x y robot robot.move robot:move frame :find_blobs
        ( ) { } [ ] = == ~= < > <= , ; : :: . .. ... + - * / // % ^ # += ..= -> ? | & ! 1 0x
        1e5 'a' "b" 'c `d `{ -- --[[ é"#;
        let longer = ["\n", "robot.on('frame', function(frame)"];
        words.split_whitespace().chain(longer).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn no_sequence_of_fragments_causes_a_panic(words in prop::collection::vec(prop::sample::select(fragments()), 0..60)) {
            let source = words.join(" ");
            let _ = checked(source.as_bytes());
            let _ = explain("test.lua:1: attempt to index nil with 'x'", "test.lua", &source);
        }

        #[test]
        fn no_text_causes_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), text in "\\PC{0,100}") {
            let _ = checked(&bytes);
            let _ = checked(text.as_bytes());
        }

        #[test]
        fn diagnostics_in_a_truncated_script_have_a_position(cut in 0usize..4000) {
            let source = include_str!("../../behaviours/patrol.lua");
            let mut cut = cut.min(source.len());
            while !source.is_char_boundary(cut) {
                cut -= 1;
            }
            for diagnostic in checked(&source.as_bytes()[..cut]) {
                prop_assert!(diagnostic.line >= 1 && diagnostic.column >= 1 && diagnostic.width >= 1);
                prop_assert!(diagnostic.carets().contains('^'), "{diagnostic}");
            }
        }

        #[test]
        fn explaining_an_error_of_the_vm_never_panics(line in 0usize..40, what in "(attempt to (index nil with '[a-z]{1,4}'|call a nil value|perform arithmetic \\((add|unm)\\) on nil( and number)?|compare nil < number|concatenate nil with string|get length of a nil value|iterate over a nil value)|invalid 'for' limit \\(number expected, got nil\\)|invalid argument #[0-9] to 'floor' \\(number expected, got nil\\)|robot.move: left must be x)") {
            let source = include_str!("../../behaviours/patrol.lua");
            let text = format!("test.lua:{line}: {what}");
            if let Some(words) = explain(&text, "test.lua", source) {
                prop_assert!(words.starts_with("test.lua:") && !words.contains("attempt to"), "{words}");
            }
        }
    }
}
