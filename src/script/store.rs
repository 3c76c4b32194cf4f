//! The values that a script keeps between runs: JSON texts by key, at most 1 MiB in total. This
//! module works in memory only; the host reads and writes the file.

use std::collections::BTreeMap;

use serde_json::value::RawValue;

/// The largest size of one script's file, in bytes.
pub(super) const QUOTA: usize = 1 << 20;
/// Bytes of an entry in the file besides key and value: quotes, colon, comma, line feed.
const ENTRY_OVERHEAD: usize = 6;
/// Bytes of the file besides its entries: braces and line feeds.
const FILE_OVERHEAD: usize = 4;

#[derive(Debug, Default)]
pub(super) struct Store {
    values: BTreeMap<String, Box<RawValue>>,
    bytes: usize,
    pub(super) changed: bool,
}

impl Store {
    pub(super) fn restore(&mut self, file: &[u8]) -> Result<(), serde_json::Error> {
        let values: BTreeMap<String, Box<RawValue>> = serde_json::from_slice(file)?;
        self.bytes = values
            .iter()
            .map(|(key, value)| cost(key, value.get()))
            .sum();
        self.values = values;
        Ok(())
    }

    pub(super) fn get(&self, key: &str) -> Option<&str> {
        self.values.get(key).map(|value| value.get())
    }

    /// Fails if the value would exceed the quota.
    pub(super) fn set(&mut self, key: String, json: String) -> Result<(), String> {
        let before = self.values.get(&key);
        if before.is_some_and(|before| before.get() == json) {
            return Ok(());
        }
        let before = before.map_or(0, |value| cost(&key, value.get()));
        let after = self.bytes - before + cost(&key, &json);
        if after + FILE_OVERHEAD > QUOTA {
            let wanted = after + FILE_OVERHEAD;
            return Err(format!(
                "the store is full: it may hold 1 MiB (1048576 bytes), and would hold {wanted}; \
                 delete what is not needed any more"
            ));
        }
        // Always JSON: it was just made.
        if let Ok(value) = RawValue::from_string(json) {
            self.values.insert(key, value);
            (self.bytes, self.changed) = (after, true);
        }
        Ok(())
    }

    pub(super) fn delete(&mut self, key: &str) -> bool {
        let Some(value) = self.values.remove(key) else {
            return false;
        };
        self.bytes -= cost(key, value.get());
        self.changed = true;
        true
    }

    pub(super) fn keys(&self) -> impl Iterator<Item = &str> {
        self.values.keys().map(String::as_str)
    }

    /// Returns the new content of the file, if it has changed since the last call.
    pub(super) fn take_file(&mut self) -> Option<Vec<u8>> {
        if !std::mem::take(&mut self.changed) {
            return None;
        }
        let mut file = String::with_capacity(self.bytes + FILE_OVERHEAD);
        let mut before = "{\n";
        for (key, value) in &self.values {
            file += before;
            file += &quoted(key);
            file += ": ";
            file += value.get();
            before = ",\n";
        }
        file += if self.values.is_empty() {
            "{}\n"
        } else {
            "\n}\n"
        };
        Some(file.into_bytes())
    }
}

fn cost(key: &str, json: &str) -> usize {
    quoted(key).len() + json.len() + ENTRY_OVERHEAD - 2
}

fn quoted(key: &str) -> String {
    // A text is always JSON.
    serde_json::to_string(key).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_full_store_keeps_its_values_and_its_file_is_within_the_quota() {
        let mut store = Store::default();
        let value = format!("\"{}\"", "x".repeat(1000));
        let full = (0..2000).find_map(|n| store.set(format!("k{n}"), value.clone()).err());
        assert!(full.unwrap().contains("1 MiB"));
        let file = store.take_file().unwrap();
        assert!(
            file.len() <= QUOTA && file.len() > QUOTA - 1100,
            "{}",
            file.len()
        );
        assert!(store.delete("k3"));
        store.set("k4".into(), "1".into()).unwrap();
        store.set("k3".into(), value).unwrap();
    }

    #[test]
    fn setting_the_same_value_again_is_not_a_change() {
        let mut store = Store::default();
        store.set("a".into(), "1".into()).unwrap();
        assert!(store.take_file().is_some());
        store.set("a".into(), "1".into()).unwrap();
        assert_eq!(store.take_file(), None);
    }

    proptest! {
        #[test]
        fn stored_values_are_restored(values in prop::collection::btree_map(".{0,20}", -1e9..1e9, 0..20)) {
            let mut store = Store::default();
            for (key, value) in &values {
                store.set(key.clone(), format!("{value}")).unwrap();
            }
            let Some(file) = store.take_file() else { return Ok(()) };
            let mut again = Store::default();
            again.restore(&file).unwrap();
            prop_assert_eq!(again.bytes, store.bytes);
            prop_assert!(file.len() <= store.bytes + FILE_OVERHEAD);
            let same = |(key, value): (&String, &f64)| again.get(key) == Some(format!("{value}").as_str());
            prop_assert!(values.iter().all(same));
        }

        #[test]
        fn a_damaged_file_never_panics(mut file in Just(b"{\n\"a\": [1, 2],\n\"b\": {}\n}\n".to_vec()), at in 0..24_usize, byte: u8) {
            file[at] = byte;
            let _ = Store::default().restore(&file);
            prop_assert!(Store::default().restore(&file[..at]).is_err());
        }
    }
}
