//! Help for a function that is called where the function itself must be passed.

use super::lexer::Span;
use super::tree::{Expr, ExprKind};

/// Maximum length of a call that is written out, in bytes.
const LONGEST: usize = 80;

/// Returns the help for an argument that must be a function but is a call, or, if the function must
/// return something (`wants_result`), an expression with a call in it; `None` for any other
/// argument. Writes out the whole call around it, if that is given.
pub(super) fn help(
    source: &str,
    argument: &Expr,
    whole: Option<Span>,
    wants_result: bool,
) -> Option<String> {
    let call = argument.bare();
    let called = match &call.kind {
        ExprKind::Call(callee, given) if given.is_empty() => callee.span.of(source),
        ExprKind::Call(..) | ExprKind::Method(..) => {
            let result = if wants_result { "return " } else { "" };
            return Some(wrapped("call", &format!("{result}{}", shown(call, source))));
        }
        ExprKind::Binary(..) | ExprKind::Unary(..) if wants_result && call.any(&Expr::is_call) => {
            let text = format!("return {}", shown(call, source));
            return Some(wrapped("evaluate", &text));
        }
        _ => return None,
    };
    let around = whole.and_then(|whole| {
        let before = source.get(whole.start..argument.span.start)?;
        let after = source.get(argument.span.end..whole.end)?;
        Some(format!("{before}{called}{after}"))
    });
    let short = around.filter(|text| is_short(text));
    let short = short.or_else(|| is_short(called).then(|| called.to_owned()));
    let written = short.map_or_else(String::new, |text| format!(": {text}"));
    Some(format!(
        "pass the function itself, without (), to be called later{written}"
    ))
}

fn wrapped(verb: &str, text: &str) -> String {
    format!("to {verb} it later, pass a function: function() {text} end")
}

/// Returns the text of an expression, or dots if it is long.
fn shown<'a>(expr: &Expr, source: &'a str) -> &'a str {
    let text = expr.span.of(source);
    if is_short(text) { text } else { "..." }
}

fn is_short(text: &str) -> bool {
    text.len() <= LONGEST && !text.contains(char::is_control)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::{CheckContext, check, explain};
    use crate::script::Options;
    use crate::script::tests::{cases, failure_with};

    const WAKE: &str = "local function wake() print('awake') end\n";
    const MODULE: &str = "local bt = require('@spykee/bt') local function yes() return true end ";

    #[test]
    fn check_writes_out_how_a_function_is_passed() {
        for (line, help) in cases(
            "robot.on('noise', wake()) => to be called later: robot.on('noise', wake)
             task.spawn(wake()) => to be called later: task.spawn(wake)
             task.every(1, wake()) => to be called later: task.every(1, wake)
             robot.on('noise', robot.led('left', true)) => pass a function: function() robot.led('left', true) end
             task.spawn(robot.move(40, 40, 1)) => pass a function: function() robot.move(40, 40, 1) end",
        ) {
            let context = CheckContext::new(&Options::new("test", "test.lua"), None);
            let found = check(format!("{WAKE}{line}").as_bytes(), "test.lua", &context);
            let helps: Vec<&str> = found.iter().filter_map(|one| one.help.as_deref()).collect();
            let [one] = helps.as_slice() else {
                panic!("{line}: {found:?}");
            };
            assert!(one.ends_with(help), "{line}: {one}");
        }
    }

    #[test]
    fn a_call_of_a_scenario_that_is_passed_gets_the_same_help() {
        let file = Path::new("a_test.lua");
        let context = CheckContext::new(&Options::new("test", "a_test.lua"), Some(file));
        let within = |line: &str| format!("scenario('a', {{}}, function(sim)\n{line}\nend)");
        for (argument, got, help) in [
            (
                "sim:docked()",
                "the result of sim:docked",
                Some("to call it later, pass a function: function() return sim:docked() end"),
            ),
            (
                "(sim:ended('a'))",
                "the result of sim:ended",
                Some("to call it later, pass a function: function() return sim:ended('a') end"),
            ),
            (
                "sim:battery() > 50",
                "true or false",
                Some(
                    "to evaluate it later, pass a function: function() return sim:battery() > 50 end",
                ),
            ),
            ("1 > 2", "true or false", None),
        ] {
            let source = within(&format!("sim:wait_until({argument}, 60)"));
            let found = check(source.as_bytes(), "a_test.lua", &context);
            let [one] = found.as_slice() else {
                panic!("{argument}: {found:?}");
            };
            let words = format!("sim:wait_until: the function must be a function, got {got}");
            assert_eq!((one.line, &one.message), (2, &words));
            assert_eq!(one.help.as_deref(), help);
            let failed = "a_test.lua:2: sim:wait_until: the function must be a function, got false";
            let text = explain(failed, "a_test.lua", &source).unwrap();
            assert!(text.ends_with(help.unwrap_or("^^^")), "{text}");
        }
        let passed = within("sim:wait_until(function() return sim:docked() end, 60)");
        assert_eq!(check(passed.as_bytes(), "a_test.lua", &context), []);
    }

    #[test]
    fn a_failed_run_says_the_same() {
        for (line, help) in cases(
            "local function id(x) return x end robot.on('noise', id()) => to be called later: robot.on('noise', id)
             local function five() return 5 end task.spawn(five()) => to be called later: task.spawn(five)
             task.race(wake(), wake) => to be called later: task.race(wake, wake)
             bt.sequence(yes, yes()) => to be called later: bt.sequence(yes, yes)
             bt.parallel({}, wake(), yes) => to be called later: bt.parallel({}, wake, yes)
             bt.retry(2, yes()) => to be called later: bt.retry(2, yes)
             bt.sequence(yes, yes(1)) => pass a function: function() return yes(1) end
             bt.retry(2, (yes(1))) => pass a function: function() return yes(1) end
             bt.guard(yes(), yes) => to be called later: bt.guard(yes, yes)",
        ) {
            let module = if line.starts_with("bt.") { MODULE } else { "" };
            let text = failure_with(&format!("{WAKE}{module}{line}"), explain);
            assert!(text.starts_with("test.lua:2: "), "{line}: {text}");
            assert!(text.ends_with(help), "{line}: {text}");
        }
    }
}
