//! The lessons, compiled into the program.

/// One lesson. Its texts are those of its folder in `behaviours/lessons/`.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::cli) struct Lesson {
    pub(super) number: usize,
    /// Its folder in `behaviours/lessons/`, such as `03-moving`.
    pub(super) folder: &'static str,
    /// The built-in world for trying out a learner's script.
    pub(super) world: &'static str,
    pub(super) readme: &'static str,
    pub(super) starter: &'static str,
    /// The scenarios that award points.
    pub(super) check: &'static str,
}

macro_rules! text {
    ($folder:literal, $file:literal) => {
        include_str!(concat!("../../../behaviours/lessons/", $folder, "/", $file))
    };
}

macro_rules! lesson {
    ($number:literal, $folder:literal, $world:literal) => {
        Lesson {
            number: $number,
            folder: $folder,
            world: $world,
            readme: text!($folder, "README.md"),
            starter: text!($folder, "starter.lua"),
            check: text!($folder, "check.lua"),
        }
    };
}

static LESSONS: [Lesson; 12] = [
    lesson!(1, "01-lights", "yard"),
    lesson!(2, "02-sounds", "yard"),
    lesson!(3, "03-moving", "yard"),
    lesson!(4, "04-square", "yard"),
    lesson!(5, "05-events", "yard"),
    lesson!(6, "06-seeing", "yard"),
    lesson!(7, "07-following", "yard"),
    lesson!(8, "08-line", "line_loop"),
    lesson!(9, "09-docking", "playpen"),
    lesson!(10, "10-patrol-and-dock", "living_room"),
    lesson!(11, "11-guard", "hall"),
    lesson!(12, "12-states", "yard"),
];

/// The line that names a script's lesson must be among this many first lines.
const HEAD_LINES: usize = 10;
/// Maximum number of digits that are read of a lesson's number.
const MAX_DIGITS: usize = 9;

impl Lesson {
    pub(super) fn all() -> &'static [Lesson] {
        &LESSONS
    }

    /// Finds a lesson by number, such as `3` or `03`, by name or title, such as `Moving`, or by both, such
    /// as `03-moving`.
    pub(super) fn named(text: &str) -> Option<&'static Lesson> {
        let is = |name: &str| text.eq_ignore_ascii_case(name);
        LESSONS.iter().find(|lesson| {
            let numbered = text.parse() == Ok(lesson.number) || is(lesson.folder);
            numbered || is(lesson.name()) || is(lesson.title())
        })
    }

    /// The lesson that a script names in one of its first lines: `-- spykee lesson 3`. If there is
    /// no lesson of that number, returns the number.
    pub(super) fn of_script(source: &str) -> Option<Result<&'static Lesson, String>> {
        source.lines().take(HEAD_LINES).find_map(|line| {
            let line = line.trim_start().strip_prefix("--")?;
            let line = line.trim_start().to_lowercase();
            let rest = line.strip_prefix("spykee lesson")?.trim_start();
            let digits = rest.chars().take_while(char::is_ascii_digit);
            let number: String = digits.take(MAX_DIGITS).collect();
            (!number.is_empty()).then(|| Lesson::named(&number).ok_or(number))
        })
    }

    /// Says that a script names another lesson than this one, if it does.
    pub(super) fn other_than_named(&self, source: &str) -> Option<String> {
        match Lesson::of_script(source)? {
            Ok(named) if named == self => None,
            Ok(named) => {
                let number = named.number;
                let title = named.title();
                Some(format!(
                    "The script names lesson {number}, {title}, at its top."
                ))
            }
            Err(number) => Some(format!(
                "The script names lesson {number} at its top, which does not exist."
            )),
        }
    }

    /// The lesson's name, such as `moving`.
    pub(super) fn name(&self) -> &'static str {
        self.folder
            .split_once('-')
            .map_or(self.folder, |(_, name)| name)
    }

    /// The file name of a learner's script.
    pub(super) fn file(&self) -> String {
        format!("{}.lua", self.name())
    }

    pub(super) fn title(&self) -> &'static str {
        let headline = self.readme.lines().next().unwrap_or_default();
        headline
            .split_once(". ")
            .map_or(headline, |(_, title)| title)
    }

    pub(super) fn subjects(&self) -> &'static str {
        let mut lines = self.readme.lines();
        let line = lines.find_map(|line| line.strip_prefix("You learn: "));
        line.unwrap_or_default().trim_end_matches('.')
    }

    /// One of the three hints, numbered from 1, in Markdown.
    pub(super) fn hint(&self, number: u8) -> Option<&'static str> {
        let opening = format!("<summary>Hint {number}</summary>");
        let (_, rest) = self.readme.split_once(&opening)?;
        rest.split("</details>").next().map(str::trim)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scenario::ScenarioFile;
    use crate::sim::World;

    #[test]
    fn lessons_are_numbered_from_one_and_their_starters_name_them() {
        for (index, lesson) in Lesson::all().iter().enumerate() {
            assert_eq!(lesson.number, index + 1);
            assert_eq!(Lesson::of_script(lesson.starter), Some(Ok(lesson)));
            for name in [
                lesson.number.to_string(),
                lesson.name().to_owned(),
                lesson.folder.to_owned(),
                lesson.title().to_owned(),
                lesson.name().to_uppercase(),
            ] {
                assert_eq!(Lesson::named(&name), Some(lesson), "{name}");
            }
            assert!(World::builtin(lesson.world).is_some(), "{}", lesson.folder);
        }
    }

    #[test]
    fn every_readme_has_all_its_sections_three_hints_and_the_commands() {
        for lesson in Lesson::all() {
            let name = lesson.folder;
            let readme = lesson.readme;
            let file = lesson.file();
            assert!(!lesson.title().is_empty() && !lesson.title().contains('#'));
            assert!(lesson.subjects().len() > 10, "{name}");
            for number in 1..=3 {
                assert!(lesson.hint(number).is_some_and(|hint| hint.len() > 30));
            }
            assert_eq!(lesson.hint(4), None, "{name}");
            for part in [
                "**Goal.**".to_owned(),
                "**What you need.**".to_owned(),
                "**Go further.**".to_owned(),
                format!("spykee run {file} --sim {}", lesson.world),
                format!("spykee lesson check {file}"),
            ] {
                assert!(readme.contains(&part), "{name}: {part}");
            }
        }
    }

    #[test]
    fn every_lesson_has_ten_points() {
        for lesson in Lesson::all() {
            let scenario_file = ScenarioFile::of_text(lesson.folder, lesson.check).unwrap();
            let points = scenario_file
                .scenarios()
                .iter()
                .map(|one| one.options.points);
            assert_eq!(points.sum::<u32>(), 10, "{}", lesson.folder);
        }
    }

    #[test]
    fn the_line_that_names_a_lesson_must_be_a_comment_near_the_top() {
        for script in [
            "-- spykee lesson 3",
            "--Spykee Lesson 3: moving\n",
            "\n\n   --   spykee lesson 03 (Ada)\r\n",
        ] {
            let lesson = Lesson::named("3").unwrap();
            assert_eq!(Lesson::of_script(script), Some(Ok(lesson)), "{script}");
        }
        for (script, number) in [("-- spykee lesson 99", "99"), ("--spykee lesson 0: x", "0")] {
            let unknown = Some(Err(number.to_owned()));
            assert_eq!(Lesson::of_script(script), unknown, "{script}");
        }
        let late = "\n".repeat(10) + "-- spykee lesson 3";
        for script in [
            "spykee lesson 3",
            "-- spykee lesson",
            "-- spykee lesson moving",
            "print('-- spykee lesson 3')",
            &late,
        ] {
            assert_eq!(Lesson::of_script(script), None, "{script}");
        }
    }

    proptest! {
        #[test]
        fn no_script_causes_a_panic(text in "(-- ?[sS]pykee lesson ?[0-9é]{0,30}|\\PC|\n){0,12}") {
            let _ = Lesson::of_script(&text);
        }
    }
}
