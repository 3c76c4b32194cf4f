//! The `behaviours:` list of the config: what to run, and how.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use crate::behaviour::{MAX_NAME, NameError, RestartPolicy, name_of};
use crate::robot::Priority;
use crate::script::{GivenParam, ParamOrigin, ParamValue};
use crate::yaml;

/// An entry of `behaviours:`.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Behaviour")]
pub struct Entry {
    /// The script, relative to the config.
    pub file: PathBuf,
    /// Its name in the log and of its data folder [default: the file's name].
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// The behaviour with the highest priority drives [default: 0].
    #[serde(default)]
    #[schemars(with = "Option<i32>", range(min = -32768, max = 32767))]
    pub priority: Priority,
    /// Whether it is restarted after a failure: `never`, `on-failure`, or a table with `policy` and
    /// its numbers [default: never].
    #[serde(default)]
    #[schemars(with = "Option<Value>")]
    pub restart: RestartPolicy,
    /// When `spykee serve` starts it: `always`, or only when `asked` [default: always; asked if it
    /// is in the timetable].
    #[serde(default)]
    pub start: Option<Start>,
    /// Values of its parameters, by name: true, false, a number or a text.
    #[serde(default)]
    #[schemars(with = "Option<BTreeMap<String, Value>>")]
    pub params: BTreeMap<String, ParamValue>,
}

/// When `spykee serve` starts a behaviour, in addition to the timetable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// As soon as the robot is connected.
    Always,
    /// Only on request by a person or the timetable.
    Asked,
}

impl Entry {
    /// An entry for a script, with the defaults for everything else.
    pub fn new(file: PathBuf) -> Entry {
        Entry {
            file,
            name: None,
            priority: Priority::default(),
            restart: RestartPolicy::default(),
            start: None,
            params: BTreeMap::new(),
        }
    }

    /// The values that it gives to its script's parameters; `origin` names the config in messages.
    pub fn given(&self, origin: &str) -> BTreeMap<String, GivenParam> {
        let given = |(name, value): (&String, &ParamValue)| {
            let value = value.clone();
            let origin = ParamOrigin::Config(origin.to_owned());
            (name.clone(), GivenParam { value, origin })
        };
        self.params.iter().map(given).collect()
    }

    /// Its name, or else the name of its file without the extension.
    pub fn name(&self) -> Result<String, NameError> {
        match &self.name {
            Some(name) => Ok(name.clone()),
            None => name_of(&self.file),
        }
    }
}

/// Reads a name of letters, digits, `-` and `_`: it is also used for a folder, so it must not lead
/// elsewhere.
fn name<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    let expected = format!("a name of at most {MAX_NAME} letters, digits, `-` and `_`");
    let name = yaml::known_text(from, &expected, |name| {
        let usual = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let good = name.chars().all(usual) && (1..=MAX_NAME).contains(&name.len());
        if good { Some(name.to_owned()) } else { None }
    });
    name.map(Some)
}

/// For `deserialize_with`: reads entries with unique names, as two of one name would share a data
/// folder. The error for a duplicate has the place of the second entry.
pub(super) fn entries<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Entry>, D::Error> {
    struct EntriesVisitor;
    impl<'de> Visitor<'de> for EntriesVisitor {
        type Value = Vec<Entry>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of behaviours, such as `- file: patrol.lua`")
        }

        fn visit_seq<S: SeqAccess<'de>>(self, mut list: S) -> Result<Vec<Entry>, S::Error> {
            let mut entries: Vec<Entry> = Vec::new();
            while let Some(entry) = list.next_element_seed(UniqueEntrySeed(&entries))? {
                entries.push(entry);
            }
            Ok(entries)
        }
    }
    from.deserialize_seq(EntriesVisitor)
}

/// Reads one more entry, whose name must differ from those of these entries.
struct UniqueEntrySeed<'a>(&'a [Entry]);

impl<'de> DeserializeSeed<'de> for UniqueEntrySeed<'_> {
    type Value = Entry;

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<Entry, D::Error> {
        from.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for UniqueEntrySeed<'_> {
    type Value = Entry;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a behaviour, such as `file: patrol.lua`")
    }

    fn visit_map<M: MapAccess<'de>>(self, map: M) -> Result<Entry, M::Error> {
        let entry = Entry::deserialize(MapAccessDeserializer::new(map))?;
        let name = entry.name().map_err(M::Error::custom)?;
        let same = |other: &&Entry| other.name().is_ok_and(|other| other == name);
        match self.0.iter().find(same) {
            Some(other) => Err(M::Error::custom(format_args!(
                "two behaviours are called `{name}` ({} and {}): give one of them another `name:`",
                other.file.display(),
                entry.file.display()
            ))),
            None => Ok(entry),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behaviour::Restarts;
    use crate::config::Config;
    use std::time::Duration;

    fn parse(text: &str) -> Result<Vec<Entry>, String> {
        let config = Config::parse(text, "spykee.yaml");
        let config = config.map_err(|error| error.to_string())?;
        Ok(config.behaviours)
    }

    #[test]
    fn all_keys_of_an_entry_are_read() {
        let text = "behaviours:\n\
                    - file: patrol.lua\n\
                    - file: lib/avoid.lua\n  \
                      name: bumper\n  \
                      priority: 10\n  \
                      restart: { policy: on-failure, max_restarts: 3 }\n  \
                      start: asked\n  \
                      params: { speed: 40, loud: true, colour: red }\n";
        let read = parse(text).unwrap();
        assert_eq!(read[0], Entry::new("patrol.lua".into()));
        assert_eq!(read[0].name().as_deref(), Ok("patrol"));
        let restarts = Restarts {
            max_restarts: 3,
            ..Restarts::default()
        };
        assert_eq!(restarts.within, Duration::from_secs(600));
        let params = [
            ("speed", ParamValue::Number(40.0)),
            ("loud", ParamValue::Boolean(true)),
            ("colour", ParamValue::Text("red".into())),
        ];
        let bumper = Entry {
            file: "lib/avoid.lua".into(),
            name: Some("bumper".into()),
            priority: Priority(10),
            restart: RestartPolicy::OnFailure(restarts),
            start: Some(Start::Asked),
            params: params.map(|(name, value)| (name.to_owned(), value)).into(),
        };
        assert_eq!(read[1], bumper);
    }

    #[test]
    fn invalid_entries_are_refused_with_their_place() {
        for (text, place, words) in [
            (
                "behaviours:\n- file: a.lua\n- file: b.lua\n- file: other/a.lua\n",
                "line 4 column 3",
                "two behaviours are called `a` (a.lua and other/a.lua)",
            ),
            (
                "behaviours:\n- { file: a.lua, name: b }\n- { name: b, file: c.lua }\n",
                "line 3 column 3",
                "called `b`",
            ),
            (
                "behaviours:\n- file: a.lua\n  name: ../b\n",
                "line 3 column 9",
                "expected a name of at most 64 letters",
            ),
            (
                "behaviours:\n- file: a.lua\n  restart: always\n",
                "line 3 column 12",
                "neither `never` nor `on-failure`",
            ),
            (
                "behaviours:\n- file: a.lua\n  restart: { policy: on-failure, max_pause: 0 }\n",
                "line 3 column 45",
                "0.05 to 86400",
            ),
            (
                "behaviours:\n- file: a.lua\n  params: { speed: [1] }\n",
                "line 3 column 20",
                "true, false, a number or a text",
            ),
            (
                "behaviours:\n- file: a.lua\n  prio: 3\n",
                "line 3 column 3",
                "prio",
            ),
            ("behaviours:\n  file: a.lua\n", "line 2 column 3", "a list"),
            (
                "behaviours:\n- a.lua\n",
                "line 2 column 3",
                "such as `file: patrol.lua`",
            ),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(place) && error.contains(words), "{error}");
        }
    }
}
