use super::*;
use proptest::prelude::*;

fn file(folder: &str, path: &str) -> Result<String, String> {
    match resolve(folder, path) {
        Ok(Target::File(name)) => Ok(name.into()),
        Ok(Target::Library(name, _)) => Ok(name.to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

#[test]
fn paths_are_relative_to_the_requiring_file() {
    assert_eq!(file("", "./lib/pid").unwrap(), "lib/pid");
    assert_eq!(file("lib", "./pid.lua").unwrap(), "lib/pid");
    assert_eq!(file("lib/a", "../../b.luau").unwrap(), "b");
    assert_eq!(file("lib", "@spykee/pid").unwrap(), "@spykee/pid");
}

#[test]
fn no_path_leaves_the_folder() {
    for (folder, path) in [
        ("", "../x"),
        ("lib", "../../x"),
        ("", "./lib/../../x"),
        ("", "/etc/passwd"),
        ("", "./lib//x"),
        ("", "./.hidden"),
        ("", "./.."),
        ("", "./lib/..\\..\\x"),
        ("", "./x\0"),
        ("", "lib/pid"),
        ("", "@spykee/../x"),
        ("", "@spikee/pid"),
        ("", ""),
        ("", "./"),
    ] {
        assert!(file(folder, path).is_err(), "{path:?}");
    }
    assert!(
        file("", "@spykee/pidd")
            .unwrap_err()
            .contains("did you mean '@spykee/pid'")
    );
}

proptest! {
    #[test]
    fn resolved_paths_stay_inside_the_folder(folder in "([a-z]{1,3}/){0,3}", path in "[./a-z@\\\\]{0,30}") {
        if let Ok(Target::File(name)) = resolve(&folder, &path) {
            for segment in name.segments() {
                prop_assert!(!segment.is_empty() && !segment.starts_with('.'));
            }
            prop_assert!(ModuleName::try_from(String::from(name.clone())).is_ok());
        }
    }
}
