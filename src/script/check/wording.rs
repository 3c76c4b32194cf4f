//! The type checker's words in ours.

use super::super::api::definition;
use super::super::failure::printable;
use super::super::nearest::suggestion;

/// No more of a message is shown, in characters.
const LONGEST: usize = 240;
const MAYBE_NIL: &str = "it may be nil: look before you use it, with if ... then";
/// What it says of what it could not find out itself, or of texts that it is too old for.
const NOT_FOR_PEOPLE: [&str; 12] = [
    "Unknown global",
    "Unknown require",
    "Code is too complex",
    "*error-type*",
    "'unknown'",
    " unknown ",
    " and unknown",
    "& ~",
    "'never'",
    "\tnever",
    "where t1 =",
    // Options: our own check knows their keys.
    "{ read ",
];

/// How it begins when something may be nil.
const NIL: &str = "Value of type '";

/// Whether it says plainly that something may be nil.
pub(super) fn says_nil(message: &str) -> bool {
    message.starts_with(NIL)
}

/// A message and what to do; nothing for what is not the person's mistake.
pub(super) fn in_words(message: &str) -> Option<(String, &'static str)> {
    if NOT_FOR_PEOPLE.iter().any(|words| message.contains(words)) {
        return None;
    }
    let message = with_our_names(message);
    let first = message.split(';').next().unwrap_or_default();
    let first = first.split_whitespace().collect::<Vec<_>>().join(" ");
    if let Some(mismatch) = first.strip_prefix("Expected this to be ") {
        return expected(mismatch);
    }
    // Of the syntax: the compiler has found none of that.
    if first.starts_with("Expected ") {
        return None;
    }
    if let Some(kind) = between(&first, NIL, "' could be nil") {
        return Some((short(&format!("this may be nil: it is {kind}")), MAYBE_NIL));
    }
    if let Some((key, owner)) = missing(&first) {
        let members = definition::object(owner).map(definition::members);
        let near = suggestion(key, members.unwrap_or_default());
        return Some((short(&format!("{owner} has no '{key}'{near}")), ""));
    }
    let first = argument(&first).or_else(|| count(&first)).unwrap_or(first);
    Some((short(&first), ""))
}

/// `the function 'robot.move' expects to get a number as its 1st argument, but is being given a string`
fn argument(message: &str) -> Option<String> {
    let (function, rest) = message
        .strip_prefix("the function '")?
        .split_once("' expects to get ")?;
    let (wanted, rest) = rest.split_once(" as its ")?;
    let (which, got) = rest.split_once(" argument, but is being given ")?;
    Some(format!(
        "{function}: the {which} argument must be {wanted}, got {got}"
    ))
}

/// `the function 'string.rep' will error at runtime if it is not called with 2 arguments, but we are
/// calling it here with 1 arguments`
fn count(message: &str) -> Option<String> {
    let (function, rest) = message
        .strip_prefix("the function '")?
        .split_once("' will error")?;
    let (_, rest) = rest.split_once(" called with ")?;
    let (takes, got) = rest.split_once(" arguments, but we are calling it here with ")?;
    let got = got.strip_suffix(" arguments")?;
    Some(format!("{function}: needs {takes} arguments, got {got}"))
}

/// `'number', but got 'Battery?'`
fn expected(mismatch: &str) -> Option<(String, &'static str)> {
    let mismatch = mismatch.strip_prefix("exactly ").unwrap_or(mismatch);
    let (wanted, got) = mismatch.split_once(" but got ")?;
    let bare = |kind: &str| {
        kind.trim_matches(|c| c == '\'' || c == ',' || c == ' ')
            .to_owned()
    };
    let (wanted, got) = (bare(wanted), bare(got));
    let maybe_nil = |kind: &str| kind.ends_with('?') || kind == "nil";
    let help = if maybe_nil(&got) && !maybe_nil(&wanted) {
        MAYBE_NIL
    } else {
        ""
    };
    Some((short(&format!("expected {wanted}, got {got}")), help))
}

/// `Key 'percnt' not found in table 'Battery'`
fn missing(message: &str) -> Option<(&str, &str)> {
    let (key, owner) = message
        .strip_prefix("Key '")?
        .split_once("' not found in ")?;
    let owner = owner.split('\'').nth(1)?;
    Some((key, owner))
}

fn between<'a>(message: &'a str, before: &str, after: &str) -> Option<&'a str> {
    message.strip_prefix(before)?.strip_suffix(after)
}

/// A call for one event is the call that the person wrote.
fn with_our_names(message: &str) -> String {
    let parts = message.split('\'');
    let named = parts.map(|part| definition::event_path(part).unwrap_or(part));
    named.collect::<Vec<_>>().join("'")
}

pub(super) fn short(message: &str) -> String {
    printable(message, LONGEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn words(message: &str) -> String {
        in_words(message).map_or_else(String::new, |(message, _)| message)
    }

    #[test]
    fn a_mismatch_names_both_types_and_a_nil_its_remedy() {
        let said =
            "Expected this to be 'number', but got 'Battery?'; \nthis is because \n\t * the 1st";
        let expected = ("expected number, got Battery?".to_owned(), MAYBE_NIL);
        assert_eq!(in_words(said), Some(expected));
        let long = "Expected this to be\n\t'{ a: number }'\nbut got\n\t'string'";
        assert_eq!(words(long), "expected { a: number }, got string");
        assert_eq!(
            words("Value of type 'Frame?' could be nil"),
            "this may be nil: it is Frame?"
        );
    }

    #[test]
    fn a_call_that_fails_is_told_like_those_that_we_find() {
        let said = "the function 'robot.move' expects to get a number as its 1st argument, but is being given a string";
        assert_eq!(
            words(said),
            "robot.move: the 1st argument must be a number, got a string"
        );
        let said = "the function 'string.rep' will error at runtime if it is not called with 2 arguments, but we are calling it here with 1 arguments";
        assert_eq!(words(said), "string.rep: needs 2 arguments, got 1");
    }

    #[test]
    fn a_field_that_does_not_exist_has_its_neighbour() {
        let said = words("Key 'percnt' not found in table 'Battery'");
        assert_eq!(said, "Battery has no 'percnt'; did you mean 'percent'?");
    }

    #[test]
    fn what_the_checker_could_not_find_out_is_nobodys_mistake() {
        assert_eq!(
            in_words("Unknown global 'scenario'; consider assigning to it first"),
            None
        );
        let guess = "Operator '-' could not be applied to operands of types number and unknown; there is no";
        assert_eq!(in_words(guess), None);
        assert_eq!(
            in_words("Expected ')' (to close '(' at column 3), got 'x'"),
            None
        );
    }

    #[test]
    fn names_that_we_have_made_up_are_not_shown() {
        let said = words("Argument count mismatch. Function '_on_3' expects 2 arguments");
        assert_eq!(
            said,
            "Argument count mismatch. Function 'robot.on' expects 2 arguments"
        );
    }

    proptest! {
        #[test]
        fn whatever_it_says_it_is_short(message in "(Expected this to be |Key '|Value of type ')?\\PC{0,400}") {
            prop_assert!(words(&message).chars().count() <= LONGEST + 1);
        }
    }
}
