//! Finds the place of a key in a YAML text. The parser reports places only in errors, so the search
//! is a deserializer that fails at the key.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

/// The error with which a successful search ends.
const FOUND: &str = "found it";

/// One step into a document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    /// Into a mapping.
    Key(String),
    /// Into a sequence, from 0.
    Index(usize),
}

/// Line and column, from 1, of the key or element at the end of the steps.
pub(super) fn find(text: &str, steps: &[Step]) -> Option<(usize, usize)> {
    if steps.is_empty() {
        return None;
    }
    let error = KeySearch(steps)
        .deserialize(serde_yaml::Deserializer::from_str(text))
        .err()?;
    let place = error.location()?;
    error
        .to_string()
        .contains(FOUND)
        .then(|| (place.line(), place.column()))
}

/// Follows its steps and fails at their end.
#[derive(Clone, Copy)]
struct KeySearch<'a>(&'a [Step]);

impl<'de> DeserializeSeed<'de> for KeySearch<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_any(self)
    }
}

impl KeySearch<'_> {
    fn check_end<E: Error>(self) -> Result<(), E> {
        if self.0.is_empty() {
            Err(E::custom(FOUND))
        } else {
            Ok(())
        }
    }
}

impl<'de> Visitor<'de> for KeySearch<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a YAML document")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Some((step, rest)) = self.0.split_first() else {
            return self.check_end();
        };
        let wanted = match step {
            Step::Key(key) => key.as_str(),
            Step::Index(_) => "",
        };
        let last = rest.is_empty();
        while let Some(found) = map.next_key_seed(Key { wanted, last })? {
            if found {
                map.next_value_seed(KeySearch(rest))?;
            } else {
                map.next_value::<IgnoredAny>()?;
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        let Some((Step::Index(wanted), rest)) = self.0.split_first() else {
            self.check_end()?;
            while list.next_element::<IgnoredAny>()?.is_some() {}
            return Ok(());
        };
        for _ in 0..*wanted {
            list.next_element::<IgnoredAny>()?;
        }
        list.next_element_seed(KeySearch(rest))?;
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(())
    }

    fn visit_bool<E: Error>(self, _: bool) -> Result<(), E> {
        self.check_end()
    }

    fn visit_i64<E: Error>(self, _: i64) -> Result<(), E> {
        self.check_end()
    }

    fn visit_u64<E: Error>(self, _: u64) -> Result<(), E> {
        self.check_end()
    }

    fn visit_f64<E: Error>(self, _: f64) -> Result<(), E> {
        self.check_end()
    }

    fn visit_str<E: Error>(self, _: &str) -> Result<(), E> {
        self.check_end()
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        self.check_end()
    }
}

/// Returns whether a key is the wanted one; fails there if it is the last step.
struct Key<'a> {
    wanted: &'a str,
    last: bool,
}

impl<'de> DeserializeSeed<'de> for Key<'_> {
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<bool, D::Error> {
        from.deserialize_str(self)
    }
}

impl Visitor<'_> for Key<'_> {
    type Value = bool;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key")
    }

    fn visit_str<E: Error>(self, key: &str) -> Result<bool, E> {
        match key == self.wanted {
            true if self.last => Err(E::custom(FOUND)),
            found => Ok(found),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn key(name: &str) -> Step {
        Step::Key(name.to_owned())
    }

    #[test]
    fn the_places_of_keys_and_elements_are_found() {
        let text = "a: 1\nb:\n  - { c: 2 }\n  - d:\n      e: [3]\n";
        assert_eq!(find(text, &[key("a")]), Some((1, 1)));
        let c = [key("b"), Step::Index(0), key("c")];
        assert_eq!(find(text, &c), Some((3, 7)));
        let e = [key("b"), Step::Index(1), key("d"), key("e")];
        assert_eq!(find(text, &e).map(|(line, _)| line), Some(5));
        assert_eq!(find(text, &[key("b"), Step::Index(2)]), None);
        assert_eq!(find(text, &[key("f")]), None);
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[ -~\n]{0,200}") {
            let _ = find(&text, &[key("a"), Step::Index(1)]);
        }
    }
}
