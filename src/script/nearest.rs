//! "Did you mean": finds the known name that is nearest to an unknown one.

/// Returns `; did you mean 'x'?`, or an empty text if no name is near.
pub fn suggestion<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(wrong, known).map_or_else(String::new, |name| format!("; did you mean '{name}'?"))
}

/// The nearest of `known`, if a person could have meant it: it may differ by one edit, or by one
/// edit per three letters; letter case does not count.
pub fn nearest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Known names are short, but a script can ask for a name of any length.
    if wrong.chars().count() > 40 {
        return None;
    }
    let lower = wrong.to_lowercase();
    let most = (lower.chars().count() / 3).max(1);
    known
        .into_iter()
        .map(|name| (strsim::osa_distance(&lower, &name.to_lowercase()), name))
        .filter(|(distance, _)| *distance <= most)
        .min()
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_suggested_and_far_ones_are_not() {
        let known = ["move", "drive", "battery", "docked"];
        assert_eq!(nearest("moev", known), Some("move"));
        assert_eq!(nearest("Battery", known), Some("battery"));
        assert_eq!(nearest("dockd", known), Some("docked"));
        assert_eq!(nearest("fly", known), None);
        assert_eq!(nearest(&"m".repeat(100_000), known), None);
    }
}
