//! The scripts of a class: a folder with a folder or a script for each learner; and which of them
//! have nearly the same text.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::catalogue::Lesson;

const MAX_LEARNERS: usize = 2000;

const NOTHING: &str = "nothing handed in";
const TWICE: &str = "handed in twice, under the same name";

/// Each learner's script, or why there is none, by name.
pub(super) type Scripts = BTreeMap<String, Result<PathBuf, String>>;

#[derive(Debug, PartialEq)]
pub(super) struct HandedIn {
    /// Those in the folder, and those on the list who are not in it.
    pub(super) learners: Scripts,
    /// Files in the folder that are no scripts.
    pub(super) others: Vec<String>,
}

pub(super) fn handed_in(folder: &Path, lesson: &Lesson, list: &[String]) -> io::Result<HandedIn> {
    let nothing = |name: &String| (name.clone(), Err(NOTHING.to_owned()));
    let mut found: Scripts = list.iter().map(nothing).collect();
    let mut others = Vec::new();
    for path in entries(folder)? {
        let (name, script) = if path.is_dir() {
            let script = match unlinked(path.clone()) {
                Ok(folder) => script_in(&folder, lesson)?,
                Err(link) => Err(link),
            };
            (name_of(path.file_name()), script)
        } else if let Some(name) = script_name(&path) {
            (name, unlinked(path))
        } else {
            others.push(name_of(path.file_name()));
            continue;
        };
        let script = match found.get(&name) {
            Some(Ok(_)) => Err(TWICE.to_owned()),
            _ => script,
        };
        found.insert(name, script);
    }
    if found.len() > MAX_LEARNERS {
        let words = format!("it has more than {MAX_LEARNERS} learners");
        return Err(io::Error::other(words));
    }
    Ok(HandedIn {
        learners: found,
        others,
    })
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

/// The name of a script without its ending, which some editors write as `.LUA` or `.lua.txt`; `None`
/// for other files.
fn script_name(path: &Path) -> Option<String> {
    let name = name_of(path.file_name());
    let small = name.to_ascii_lowercase();
    let stem = small.strip_suffix(".txt").unwrap_or(&small);
    let stem = stem.strip_suffix(".lua")?;
    let is_script = stem != "check" && !stem.ends_with("_test");
    // Lower case has as many bytes: only ASCII letters have changed.
    (is_script && (path.is_file() || path.is_symlink())).then(|| name[..stem.len()].to_owned())
}

/// Refuses a symbolic link: it could point to another learner's script, or to any file of the
/// teacher.
fn unlinked(path: PathBuf) -> Result<PathBuf, String> {
    if path.is_symlink() {
        Err("handed in as a symbolic link, which is not followed".to_owned())
    } else {
        Ok(path)
    }
}

/// The script in the folder with the lesson's name, such as `moving.lua` or `03-moving.lua`, or else the
/// only one. If there is none, those in its folders count, such as `lesson-03-moving`, which `spykee
/// lesson start` makes.
fn script_in(folder: &Path, lesson: &Lesson) -> io::Result<Result<PathBuf, String>> {
    let mut scripts = scripts_in(folder)?;
    if scripts.is_empty() {
        for path in entries(folder)? {
            if path.is_dir() && !path.is_symlink() {
                scripts.extend(scripts_in(&path)?);
            }
        }
    }
    let wanted = lesson.file();
    let is_wanted = |path: &&PathBuf| {
        let name = script_name(path);
        name.is_some_and(|name| name == lesson.name() || name == lesson.folder)
    };
    Ok(match (scripts.iter().find(is_wanted), scripts.as_slice()) {
        (Some(path), _) | (None, [path]) => unlinked(path.clone()),
        (None, []) => Err(NOTHING.to_owned()),
        (None, several) => Err(format!(
            "{} scripts handed in, but none is called {wanted}",
            several.len()
        )),
    })
}

fn scripts_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut scripts = entries(folder)?;
    scripts.retain(|path| script_name(path).is_some());
    Ok(scripts)
}

/// Texts with at least this similarity, from 0 to 1, are nearly the same.
const NEARLY_THE_SAME: f64 = 0.92;
/// Minimum length of a learner's own text for a comparison, in characters.
const SHORTEST: usize = 60;
const LONGEST: usize = 20_000;

/// A pair of texts in a list that are nearly the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    /// Their indices in the list, in ascending order.
    pub(super) places: (usize, usize),
    pub(super) similarity: f64,
}

/// All pairs of scripts with nearly the same text, the most similar first. Ignores lines from the
/// lesson's starter, and texts that are too short: solutions of a few lines are similar without
/// being copied.
pub(super) fn pairs(texts: &[Option<String>], starter: &str) -> Vec<Pair> {
    let own = |text: &Option<String>| text.as_deref().and_then(|text| own_words(text, starter));
    let own: Vec<Option<String>> = texts.iter().map(own).collect();
    let mut pairs = Vec::new();
    for (first, one) in own.iter().enumerate() {
        for (second, other) in own.iter().enumerate().skip(first + 1) {
            let (Some(one), Some(other)) = (one, other) else {
                continue;
            };
            let similarity = strsim::sorensen_dice(one, other);
            if similarity >= NEARLY_THE_SAME {
                let places = (first, second);
                pairs.push(Pair { places, similarity });
            }
        }
    }
    pairs.sort_by(|one, other| other.similarity.total_cmp(&one.similarity));
    pairs
}

/// The lines that are not in the starter, without spaces and with the same name for all that they
/// declare; `None` if they are too short.
fn own_words(text: &str, starter: &str) -> Option<String> {
    let given: Vec<String> = starter.lines().map(without_spaces).collect();
    let own = text
        .lines()
        .filter(|line| !given.contains(&without_spaces(line)));
    let own = without_spaces(&with_names_alike(&own.collect::<Vec<_>>().join("\n")));
    (own.chars().count() >= SHORTEST).then(|| own.chars().take(LONGEST).collect())
}

/// The text with one name for its variables and functions: whoever renames those of a copy has copied.
fn with_names_alike(text: &str) -> String {
    let is_in_word = |c: char| c.is_alphanumeric() || c == '_';
    let words: Vec<&str> = text.split_inclusive(|c| !is_in_word(c)).collect();
    let word = |piece: &&str| piece.trim_end_matches(|c| !is_in_word(c)).to_owned();
    let mut declared = BTreeSet::new();
    let mut declares = false;
    for piece in &words {
        match &word(piece)[..] {
            "local" | "for" | "function" => declares = true,
            "in" => declares = false,
            name => {
                if declares && !name.is_empty() {
                    declared.insert(name.to_owned());
                }
                declares &= !piece.ends_with(['=', '\n', ')']);
            }
        }
    }
    let alike = |piece: &&str| match word(piece) {
        name if declared.contains(&name) => format!("v{}", &piece[name.len()..]),
        _ => (*piece).to_owned(),
    };
    words.iter().map(alike).collect()
}

fn without_spaces(line: &str) -> String {
    line.chars().filter(|c| !c.is_whitespace()).collect()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn learners_are_found_by_folder_or_script_and_missing_ones_by_the_list() {
        let class = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        for folder in [
            "Ada",
            "Ben",
            "Cem",
            "Dora",
            ".git",
            "Kim/lesson-03-moving",
            "Lea",
        ] {
            fs::create_dir_all(class.path().join(folder)).unwrap();
        }
        for file in [
            "Ada/moving.lua",
            "Ada/other.lua",
            "Kim/lesson-03-moving/moving.lua",
            "Lea/Moving.lua.txt",
            "Max.LUA",
            "Nia.LUA",
            "Nia.lua",
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
        let found = handed_in(class.path(), lesson, &list).unwrap();
        assert_eq!(found.others, ["notes.txt"]);
        let shown: Vec<String> = found
            .learners
            .iter()
            .map(|(name, script)| match script {
                Ok(path) => {
                    let path = path.strip_prefix(class.path()).unwrap();
                    format!("{name}: {}", path.display())
                }
                Err(why) => format!("{name}: {why}"),
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
                "Kim: Kim/lesson-03-moving/moving.lua",
                "Lea: Lea/Moving.lua.txt",
                "Max: Max.LUA",
                "Nia: handed in twice, under the same name",
            ]
        );
    }

    const STARTER: &str = "-- spykee lesson 5\nrobot.led('all', true)\nrobot.turn(math.rad(360))\n";

    fn script(middle: &str) -> Option<String> {
        Some(format!(
            "{STARTER}robot.on('noise', function(noise)\n  {middle}\n  print('I am awake now', noise.dbfs)\n\
             \tfor count = 1, 3 do robot.play('bip_2') task.wait(0.3) end\nend)\n"
        ))
    }

    #[test]
    fn a_copy_with_other_spaces_and_small_changes_is_found() {
        let one = "robot.led('all', true)";
        let other = "robot.led(  'all',  true )";
        let texts = [
            script(one),
            script(other),
            None,
            script(
                "robot.turn(math.rad(180)) log.info('this is all of my very own idea, and long')",
            ),
        ];
        let found = pairs(&texts, STARTER);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].places, (0, 1));
    }

    #[test]
    fn a_copy_with_other_names_is_found_and_another_idea_is_not() {
        let one = "local count, side = 4, 0.5\nlocal function corner(angle)\n\trobot.turn(angle)\nend\n\
                   for step = 1, count do\n\trobot.forward(side)\n\tcorner(math.pi / 2)\nend\n";
        let copy = one.replace("count", "anzahl").replace("side", "s");
        let copy = copy.replace("corner", "ecke").replace("angle", "wie_weit");
        let idea = "local count = 4\nrepeat\n\trobot.forward(0.5)\n\trobot.turn(math.pi / 2)\n\
                    \tcount -= 1\nuntil count == 0\nrobot.play('bip_2')\n";
        let texts = [one, &copy.replace("step", "i"), idea];
        let texts = texts.map(|text| Some(format!("{STARTER}{text}")));
        let found = pairs(&texts, STARTER);
        let places: Vec<(usize, usize)> = found.iter().map(|pair| pair.places).collect();
        assert_eq!(places, [(0, 1)], "{found:?}");
    }

    #[test]
    fn the_starter_and_short_solutions_are_not_copies() {
        let short = Some(format!("{STARTER}robot.led('all', false)\n"));
        let starter = Some(STARTER.repeat(9));
        assert_eq!(
            pairs(&[short.clone(), short, starter.clone(), starter], STARTER),
            []
        );
    }
}
