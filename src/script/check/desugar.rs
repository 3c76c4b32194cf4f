//! A script as the type checker can judge it, byte for byte as long and line for line the same: it
//! knows no other files, and not that what a handler gets depends on the event's name.

use super::super::api::definition;
use super::lexer::Span;
use super::tree::{Expr, ExprKind, Tree};

/// The text with calls replaced: `require("./lib/pid")` by a call that gives anything, `robot.on`
/// with a name that is written out by the function for that event.
pub(super) fn desugared(source: &str, tree: &Tree) -> String {
    let mut edits: Vec<(Span, String)> = Vec::new();
    tree.each_expr(&mut |expr| edits.extend(edit(expr)));
    let mut text = source.to_owned();
    for (span, name) in edits {
        let padded = padded(&name, span.of(source));
        if let Some(padded) = padded {
            text.replace_range(span.start..span.end, &padded);
        }
    }
    text
}

fn edit(expr: &Expr) -> Option<(Span, String)> {
    let ExprKind::Call(callee, arguments) = &expr.kind else {
        return None;
    };
    let ExprKind::Text(first) = &arguments.first()?.kind else {
        return None;
    };
    match &callee.kind {
        ExprKind::Global(name) if name == "require" => {
            Some((expr.span, definition::MODULE_CALL.to_owned()))
        }
        ExprKind::Field(owner, name, _) => {
            let ExprKind::Global(owner) = &owner.kind else {
                return None;
            };
            let function = definition::function(&format!("{owner}.{name}"))?;
            Some((callee.span, definition::event_name(function, first)?))
        }
        _ => None,
    }
}

/// The name, with blanks where it is shorter than the old text, and that one's line ends where they
/// were; nothing if there is no room.
fn padded(name: &str, old: &str) -> Option<String> {
    let line = old.lines().next()?;
    if name.len() > line.len() || line.starts_with("--") {
        return None;
    }
    let blank = |byte: u8| if byte == b'\n' { '\n' } else { ' ' };
    let rest = old.bytes().skip(name.len()).map(blank);
    Some(name.chars().chain(rest).collect())
}

#[cfg(test)]
mod tests {
    use super::super::parser::parse;
    use super::*;
    use proptest::prelude::*;

    fn text(source: &str) -> String {
        desugared(source, &parse(source).unwrap())
    }

    #[test]
    fn events_have_calls_of_their_own_and_modules_are_anything() {
        let before =
            "local pid = require(\"./pid\")\nrobot.on(\"frame\", print)\nrobot.on(name, print)";
        let after = text(before);
        assert_eq!(after.len(), before.len());
        assert!(
            after.starts_with("local pid = _module()       \n_on_"),
            "{after}"
        );
        assert!(after.ends_with("robot.on(name, print)"), "{after}");
    }

    #[test]
    fn a_local_robot_is_somebody_elses() {
        let source = "local robot = {}\nrobot.on('frame', print)";
        assert_eq!(text(source), source);
    }

    proptest! {
        #[test]
        fn length_and_lines_stay(
            words in prop::collection::vec(prop::sample::select(vec![
                "require(\"./a\")", "robot.on('frame',", "robot\n.on('battery', print)", "print)",
                "local a =", "\n", "robot.once('docked', print)", "-- ä\n", "require [[\n./b]]",
            ]), 0..12),
        ) {
            let source = words.join(" ");
            if let Ok(tree) = parse(&source) {
                let after = desugared(&source, &tree);
                prop_assert_eq!(after.len(), source.len());
                let ends = |text: &str| text.match_indices('\n').map(|(at, _)| at).collect::<Vec<_>>();
                prop_assert_eq!(ends(&after), ends(&source));
            }
        }
    }
}
