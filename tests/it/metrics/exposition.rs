//! A strict parser of OpenMetrics text 1.0, as far as our metrics use it: it refuses whatever
//! Prometheus would refuse or misread. <https://prometheus.io/docs/specs/om/open_metrics_spec/>

use std::collections::{BTreeMap, BTreeSet};

/// The samples of one metric family.
#[derive(Debug, Default)]
pub struct Family {
    pub kind: String,
    pub help: String,
    unit: Option<String>,
    pub samples: Vec<Sample>,
}

/// One sample line.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The suffix after the family's name: `_total`, `_bucket` or empty.
    pub suffix: String,
    pub labels: Vec<(String, String)>,
    pub value: f64,
}

/// Parses all families by name, or returns the error and its place.
pub fn read(text: &str) -> Result<BTreeMap<String, Family>, String> {
    let body = text
        .strip_suffix("# EOF\n")
        .ok_or("it does not end with `# EOF`")?;
    let mut families: BTreeMap<String, Family> = BTreeMap::new();
    let mut current: Option<String> = None;
    for (index, line) in body.lines().enumerate() {
        let in_line = |error: String| format!("line {}: {error}: {line}", index + 1);
        match line.strip_prefix("# ") {
            Some(about) => describe(about, &mut families, &mut current).map_err(in_line)?,
            None => {
                let name = current
                    .as_ref()
                    .ok_or("a sample without a family")
                    .map_err(|error| in_line(error.into()))?;
                let sample = sample(line, name).map_err(in_line)?;
                families
                    .entry(name.clone())
                    .or_default()
                    .samples
                    .push(sample);
            }
        }
    }
    for (name, family) in &families {
        family
            .check(name)
            .map_err(|error| format!("{name}: {error}"))?;
    }
    Ok(families)
}

fn is_name(text: &str) -> bool {
    let fits = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == ':';
    text.chars().all(fits) && text.starts_with(|c: char| !c.is_ascii_digit())
}

/// `HELP name text`, `TYPE name kind` or `UNIT name unit`.
fn describe(
    about: &str,
    families: &mut BTreeMap<String, Family>,
    current: &mut Option<String>,
) -> Result<(), String> {
    let mut words = about.splitn(3, ' ');
    let (Some(what), Some(name), Some(rest)) = (words.next(), words.next(), words.next()) else {
        return Err("fewer than three words".into());
    };
    if !is_name(name) {
        return Err("not a valid name".into());
    }
    if current.as_deref() != Some(name) {
        if families.contains_key(name) {
            return Err("the lines of a family are not contiguous".into());
        }
        *current = Some(name.to_owned());
    }
    let family = families.entry(name.to_owned()).or_default();
    if !family.samples.is_empty() {
        return Err("it comes after its samples".into());
    }
    let before = match what {
        "HELP" => std::mem::replace(&mut family.help, rest.to_owned()),
        "TYPE" => std::mem::replace(&mut family.kind, rest.to_owned()),
        "UNIT" => family.unit.replace(rest.to_owned()).unwrap_or_default(),
        _ => return Err("neither HELP nor TYPE nor UNIT".into()),
    };
    match before.is_empty() {
        true => Ok(()),
        false => Err("it is given twice".into()),
    }
}

fn sample(line: &str, family: &str) -> Result<Sample, String> {
    let suffix = line
        .strip_prefix(family)
        .ok_or("a sample of another family")?;
    let end = suffix.find(['{', ' ']).ok_or("no value")?;
    let (suffix, mut rest) = suffix.split_at(end);
    let mut labels = Vec::new();
    if let Some(inner) = rest.strip_prefix('{') {
        rest = read_labels(inner, &mut labels)?;
    }
    let value = rest.strip_prefix(' ').ok_or("no space before the value")?;
    let value: f64 = match value {
        "+Inf" => f64::INFINITY,
        "NaN" => f64::NAN,
        number if number.starts_with(|c: char| c.is_ascii_digit() || c == '-') => {
            number.parse().map_err(|_| "not a number")?
        }
        _ => return Err("not a number".into()),
    };
    let names: BTreeSet<&String> = labels.iter().map(|(name, _)| name).collect();
    if names.len() != labels.len() {
        return Err("duplicate label".into());
    }
    let suffix = suffix.to_owned();
    Ok(Sample {
        suffix,
        labels,
        value,
    })
}

/// Parses the labels; returns the rest of the line.
fn read_labels<'a>(
    mut rest: &'a str,
    labels: &mut Vec<(String, String)>,
) -> Result<&'a str, String> {
    loop {
        if let Some(rest) = rest.strip_prefix('}') {
            return Ok(rest);
        }
        if !labels.is_empty() {
            rest = rest.strip_prefix(',').ok_or("no comma between labels")?;
        }
        let (name, value) = rest.split_once("=\"").ok_or("a label without a value")?;
        if !is_name(name) || name.contains(':') {
            return Err("the name of a label is not valid".into());
        }
        let (mut text, mut chars) = (String::new(), value.char_indices());
        let end = loop {
            match chars.next().ok_or("an unterminated label")? {
                (at, '"') => break at,
                (_, '\\') => match chars.next() {
                    Some((_, c @ ('"' | '\\' | 'n'))) => text.push(c),
                    _ => return Err("unknown escape".into()),
                },
                (_, c) => text.push(c),
            }
        };
        labels.push((name.to_owned(), text));
        rest = &value[end + 1..];
    }
}

impl Family {
    fn check(&self, name: &str) -> Result<(), String> {
        if self.help.is_empty() {
            return Err("no HELP".into());
        }
        if let Some(unit) = &self.unit
            && !name.ends_with(&format!("_{unit}"))
        {
            return Err(format!("its name does not end with its unit, {unit}"));
        }
        let suffixes: &[&str] = match self.kind.as_str() {
            "gauge" => &[""],
            "counter" => &["_total"],
            "histogram" => &["_bucket", "_sum", "_count"],
            kind => return Err(format!("unknown TYPE `{kind}`")),
        };
        let mut seen = BTreeSet::new();
        for one in &self.samples {
            if !suffixes.contains(&one.suffix.as_str()) {
                return Err(format!("a {} has no suffix `{}`", self.kind, one.suffix));
            }
            if !seen.insert((&one.suffix, &one.labels)) {
                return Err(format!("duplicate labels {:?}", one.labels));
            }
            if self.kind != "gauge" && !(one.value >= 0.0 && one.value.is_finite()) {
                return Err(format!("invalid value {}", one.value));
            }
        }
        match self.kind.as_str() {
            "histogram" => self.check_buckets(),
            _ => Ok(()),
        }
    }

    /// Checks that buckets are cumulative and in order up to `+Inf`, which equals the count.
    fn check_buckets(&self) -> Result<(), String> {
        let of = |suffix: &'static str| self.samples.iter().filter(move |one| one.suffix == suffix);
        let bound = |one: &Sample| match &one.labels[..] {
            [(le, bound)] if le == "le" => match bound.as_str() {
                "+Inf" => Ok(f64::INFINITY),
                bound => bound
                    .parse()
                    .map_err(|_| format!("invalid bucket `{bound}`")),
            },
            labels => Err(format!("a bucket with the labels {labels:?}")),
        };
        let (mut last, mut count) = (f64::NEG_INFINITY, 0.0);
        for bucket in of("_bucket") {
            let bound: f64 = bound(bucket)?;
            if bound <= last || bucket.value < count {
                return Err("the buckets are not cumulative".into());
            }
            (last, count) = (bound, bucket.value);
        }
        let counts: Vec<f64> = of("_count").map(|one| one.value).collect();
        match last == f64::INFINITY && counts == [count] && of("_sum").count() == 1 {
            true => Ok(()),
            false => Err("buckets, count and sum do not agree".into()),
        }
    }
}

#[test]
fn metrics_that_prometheus_would_misread_are_refused() {
    let good = "# HELP a_seconds Of it.\n# TYPE a_seconds histogram\n# UNIT a_seconds seconds\n\
                a_seconds_bucket{le=\"0.1\"} 1\na_seconds_bucket{le=\"+Inf\"} 2\na_seconds_sum 0.4\n\
                a_seconds_count 2\n# HELP b What.\n# TYPE b counter\nb_total{c=\"x\\\"y\"} 1\n# EOF\n";
    let families = read(good).unwrap();
    assert_eq!(families["b"].samples[0].labels[0].1, "x\"y");
    for (from, to) in [
        ("# EOF\n", ""),
        ("# EOF\n", "# EOF\nb_total 2\n"),
        ("b_total", "b"),
        ("b_total{c=\"x\\\"y\"} 1", "b_total{c=\"x\"y\"} 1"),
        ("b_total{c=\"x\\\"y\"} 1", "b_total{c=\"x\"} NaN"),
        (
            "b_total{c=\"x\\\"y\"} 1",
            "b_total{c=\"x\"} 1\nb_total{c=\"x\"} 1",
        ),
        ("b_total{c=\"x\\\"y\"} 1", "b_total{c=\"x\",c=\"y\"} 1"),
        (
            "b_total{c=\"x\\\"y\"} 1",
            "b_total 1\n# TYPE a_seconds gauge",
        ),
        ("b_total{c=\"x\\\"y\"} 1", "b_total one"),
        ("b_total{c=\"x\\\"y\"} 1", "b_total"),
        ("# HELP b What.\n", ""),
        ("# TYPE b counter\n", ""),
        ("# TYPE b counter", "# TYPE b thing"),
        ("# TYPE b counter", "# TYPE b counter\n# TYPE b counter"),
        ("# UNIT a_seconds seconds", "# UNIT a_seconds bytes"),
        ("{le=\"0.1\"} 1", "{le=\"0.1\"} 3"),
        ("{le=\"0.1\"}", "{le=\"soon\"}"),
        ("{le=\"+Inf\"}", "{le=\"5\"}"),
        ("a_seconds_count 2", "a_seconds_count 3"),
        ("a_seconds_sum 0.4\n", ""),
    ] {
        let bad = good.replacen(from, to, 1);
        assert_ne!(bad, good, "{from}");
        assert!(read(&bad).is_err(), "{bad}");
    }
}
