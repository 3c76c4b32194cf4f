//! The scripts of a class: a folder with a folder or a script for each learner.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::catalogue::Lesson;

const MAX_LEARNERS: usize = 2000;

/// Why a learner has no script.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum NotHandedIn {
    #[error("nothing handed in")]
    Nothing,
    #[error("{count} scripts handed in, but none is called {wanted}")]
    Several { count: usize, wanted: String },
    #[error("handed in as a symbolic link, which is not followed")]
    Link,
}

#[derive(Debug, PartialEq)]
pub(super) struct Learner {
    pub(super) name: String,
    /// The script, or why there is none.
    pub(super) script: Result<PathBuf, NotHandedIn>,
}

/// All learners, sorted by name: those in the folder, and those on the list who are not in it.
pub(super) fn learners(
    folder: &Path,
    lesson: &Lesson,
    list: &[String],
) -> io::Result<Vec<Learner>> {
    let nothing = |name: &String| (name.clone(), Err(NotHandedIn::Nothing));
    let mut found: BTreeMap<String, Result<PathBuf, NotHandedIn>> =
        list.iter().map(nothing).collect();
    for path in entries(folder)? {
        let (name, script) = if path.is_dir() {
            let script = match unlinked(path.clone()) {
                Ok(folder) => script_in(&folder, lesson)?,
                Err(link) => Err(link),
            };
            (name_of(path.file_name()), script)
        } else if is_script(&path) {
            (name_of(path.file_stem()), unlinked(path))
        } else {
            continue;
        };
        found.insert(name, script);
    }
    if found.len() > MAX_LEARNERS {
        let words = format!("it has more than {MAX_LEARNERS} learners");
        return Err(io::Error::other(words));
    }
    let learner = |(name, script)| Learner { name, script };
    Ok(found.into_iter().map(learner).collect())
}

/// The entries of a folder, sorted by name, without hidden ones.
fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder)?.take(4 * MAX_LEARNERS) {
        let entry = entry?;
        if !entry.file_name().as_encoded_bytes().starts_with(b".") {
            paths.push(entry.path());
        }
    }
    paths.sort();
    Ok(paths)
}

fn name_of(name: Option<&std::ffi::OsStr>) -> String {
    name.unwrap_or_default().to_string_lossy().into_owned()
}

fn is_script(path: &Path) -> bool {
    let name = name_of(path.file_name());
    let named = name.ends_with(".lua") && name != "check.lua" && !name.ends_with("_test.lua");
    named && (path.is_file() || path.is_symlink())
}

/// Refuses a symbolic link: it could point to another learner's script, or to any file of the
/// teacher.
fn unlinked(path: PathBuf) -> Result<PathBuf, NotHandedIn> {
    if path.is_symlink() {
        Err(NotHandedIn::Link)
    } else {
        Ok(path)
    }
}

/// The script in the folder with the lesson's name, or else the only one.
fn script_in(folder: &Path, lesson: &Lesson) -> io::Result<Result<PathBuf, NotHandedIn>> {
    let wanted = lesson.file();
    let scripts: Vec<PathBuf> = entries(folder)?
        .into_iter()
        .filter(|path| is_script(path))
        .collect();
    let named = scripts.iter().find(|path| path.ends_with(&wanted));
    Ok(match (named, scripts.as_slice()) {
        (Some(path), _) | (None, [path]) => unlinked(path.clone()),
        (None, []) => Err(NotHandedIn::Nothing),
        (None, several) => Err(NotHandedIn::Several {
            count: several.len(),
            wanted,
        }),
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn learners_are_found_by_folder_or_script_and_missing_ones_by_the_list() {
        let class = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        for folder in ["Ada", "Ben", "Cem", "Dora", ".git"] {
            fs::create_dir(class.path().join(folder)).unwrap();
        }
        for file in [
            "Ada/moving.lua",
            "Ada/other.lua",
            "Ben/mine.lua",
            "Cem/a.lua",
            "Cem/b.lua",
            "Eva.lua",
            "notes.txt",
        ] {
            fs::write(class.path().join(file), "").unwrap();
        }
        fs::create_dir(class.path().join("Gus")).unwrap();
        fs::write(elsewhere.path().join("moving.lua"), "").unwrap();
        for (target, link) in [
            ("moving.lua", "Gus/moving.lua"),
            ("moving.lua", "Hal.lua"),
            ("nowhere.lua", "Ida.lua"),
            (".", "Jim"),
        ] {
            let target = elsewhere.path().join(target);
            symlink(target, class.path().join(link)).unwrap();
        }
        let lesson = Lesson::named("3").unwrap();
        let list = ["Ada".to_owned(), "Finn".to_owned()];
        let found = learners(class.path(), lesson, &list).unwrap();
        let shown: Vec<String> = found
            .iter()
            .map(|one| match &one.script {
                Ok(path) => {
                    let path = path.strip_prefix(class.path()).unwrap();
                    format!("{}: {}", one.name, path.display())
                }
                Err(why) => format!("{}: {why}", one.name),
            })
            .collect();
        assert_eq!(
            shown,
            [
                "Ada: Ada/moving.lua",
                "Ben: Ben/mine.lua",
                "Cem: 2 scripts handed in, but none is called moving.lua",
                "Dora: nothing handed in",
                "Eva: Eva.lua",
                "Finn: nothing handed in",
                "Gus: handed in as a symbolic link, which is not followed",
                "Hal: handed in as a symbolic link, which is not followed",
                "Ida: handed in as a symbolic link, which is not followed",
                "Jim: handed in as a symbolic link, which is not followed",
            ]
        );
    }
}
