use super::explain;
use crate::script::tests::failure_with;

/// The message with which a broken script fails on a robot that sees nothing.
fn failure_of(source: &str) -> String {
    failure_with(source, explain)
}

#[test]
fn a_failure_shows_the_line_with_a_caret_below_what_was_nil() {
    let message = failure_of("local battery\nprint('level', battery.percent)\nbattery = 1");
    let expected = "test.lua:2: `battery` is nil here, so `battery.percent` cannot be read\n\
                    2 | print('level', battery.percent)\n  |                ^^^^^^^\n  = help: ";
    assert!(message.starts_with(expected), "{message}");
    let message = failure_of("local b = robot.wait_for('docked', 0.1)\nprint(b.x)");
    assert!(
        message.contains("robot.wait_for returns nil after a time-out; test it first: if b then"),
        "{message}"
    );
    let message =
        failure_of("local blobs = robot.wait_frame(5):find_blobs('red')\nprint(blobs[1].cx)");
    assert!(message.contains("find_blobs found none"), "{message}");
}

#[test]
fn errors_of_the_vm_are_explained_in_plain_words() {
    for (source, words) in [
        (
            "local f\nf()",
            "test.lua:2: `f` is nil here, so it cannot be called\n2 | f()\n  | ^\n  = help: there is no function of that name here",
        ),
        (
            "print(robot.battery().percent)",
            "test.lua:1: `robot.battery()` is nil here, so `robot.battery().percent` cannot be read",
        ),
        (
            "print(1 + nil)",
            "test.lua:1: this is nil, so it cannot be used in arithmetic",
        ),
        (
            "print(1 < nil)",
            "test.lua:1: this is nil, so it cannot be compared with < or >",
        ),
        (
            "table.sort({1, 'a'})",
            "test.lua:1: only numbers can be compared with numbers",
        ),
        (
            "print('a' .. {})",
            "test.lua:1: `{}` is a table here, so it cannot be joined to a string",
        ),
    ] {
        let text = failure_of(source);
        assert!(text.contains(words), "{source}: {text:?} lacks {words:?}");
    }
}
