//! The name of a behaviour, which appears in the log and is the name of its data folder. A name
//! must therefore not contain path separators or unprintable characters.

use std::path::Path;

use crate::sanitize;

pub const MAX_NAME: usize = 64;

/// Why a name is not allowed. The name is displayed in a sanitised form.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a behaviour cannot be called `{shown}`: {why}; set another `name:` or rename the file")]
pub struct NameError {
    shown: String,
    why: &'static str,
}

/// Returns the name of the behaviour in this file: the file name without its last extension.
pub fn name_of(file: &Path) -> Result<String, NameError> {
    let stem = file.file_stem().unwrap_or_default();
    match stem.to_str() {
        Some(stem) => validate_name(stem).map(|()| stem.to_owned()),
        None => Err(refused(&stem.to_string_lossy(), "it is not UTF-8")),
    }
}

pub fn validate_name(name: &str) -> Result<(), NameError> {
    let why = if name.is_empty() {
        "it is empty"
    } else if name.starts_with('.') {
        "it begins with a dot"
    } else if name.chars().count() > MAX_NAME {
        "it has more than 64 characters"
    } else if name.contains(['/', '\\', ':']) {
        "it contains a slash, a backslash or a colon"
    } else if sanitize::line(name) != name {
        "it contains unprintable characters"
    } else {
        return Ok(());
    };
    Err(refused(name, why))
}

fn refused(name: &str, why: &'static str) -> NameError {
    let shown = sanitize::line(&name.chars().take(MAX_NAME).collect::<String>());
    NameError { shown, why }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn usual_names_pass() {
        for (file, name) in [
            ("behaviours/patrol.lua", "patrol"),
            ("my robot.lua", "my robot"),
            ("größe-2.luau", "größe-2"),
            ("a.b.lua", "a.b"),
            ("repl", "repl"),
        ] {
            assert_eq!(name_of(Path::new(file)).as_deref(), Ok(name));
        }
    }

    #[test]
    fn names_with_separators_or_unprintable_characters_are_refused() {
        for file in [
            "...lua",
            "..lua",
            ".hidden.lua",
            "",
            "..",
            "a\u{1b}[2J.lua",
            "a\nb.lua",
            "a\u{202e}b.lua",
            "a\u{9b}b.lua",
            "a\\b.lua",
            "c:x.lua",
        ] {
            let error = name_of(Path::new(file)).unwrap_err().to_string();
            let harmless = error.chars().all(|c| !c.is_control() && c != '\u{202e}');
            assert!(harmless, "{error:?}");
        }
        assert!(name_of(Path::new(&format!("{}.lua", "a".repeat(65)))).is_err());
        assert!(validate_name("a/b").is_err());
    }

    proptest! {
        #[test]
        fn a_valid_name_is_a_single_path_component(name in "\\PC{0,20}|[./\\\\a\u{1b}\n\u{202e}]{0,8}") {
            if validate_name(&name).is_ok() {
                let parts: Vec<_> = Path::new(&name).components().collect();
                prop_assert!(matches!(parts[..], [std::path::Component::Normal(part)] if part == &*name));
            }
        }
    }
}
