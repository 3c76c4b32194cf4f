//! The `notify:` section of the config.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Rule;
use super::template;
use crate::robot::Seconds;

/// Maximum number of targets, since each has a thread.
const MAX_TARGETS: usize = 8;
/// Maximum length of a target's name, in bytes.
const LONGEST_NAME: usize = 40;
const LONGEST_TOPIC: usize = 200;

/// Which messages go to which targets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "NotifyOptions")]
pub struct Options {
    /// A robot that is out of reach for this many seconds is reported: 600.
    pub unreachable_after: Seconds,
    /// The targets, by name.
    pub targets: BTreeMap<String, Target>,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            unreachable_after: Seconds::from_secs(600),
            targets: BTreeMap::new(),
        }
    }
}

/// A webhook, by `url`, a message at the broker of `mqtt:`, by `topic`, or a command. `{text}`,
/// `{title}`, `{event}`, `{robot}`, `{time}`, `{picture}` (the file's name) and, for webhooks,
/// `{token}` in its texts are filled in.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "NotifyTarget")]
pub struct Target {
    /// The address of a webhook.
    pub url: Option<String>,
    /// Header fields of a webhook.
    pub headers: BTreeMap<String, String>,
    /// A topic of the broker of `mqtt:`.
    pub topic: Option<String>,
    /// The text that a webhook or a topic is sent [default, without `json`: `{text}`].
    pub body: Option<String>,
    /// The JSON that it is sent; the strings in it are filled in.
    pub json: Option<Value>,
    /// How a picture is sent with it; to a topic `none` or `body`.
    pub picture: PictureMode,
    /// A file with `{token}` in its first line.
    pub token_file: Option<PathBuf>,
    /// A program and its arguments; it reads the text on its standard input.
    pub command: Vec<String>,
    /// The events it is notified of [default: all].
    pub on: Option<Vec<Rule>>,
}

/// How a picture is sent with a message to a webhook or a topic.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "NotifyPicture")]
pub enum PictureMode {
    /// No picture.
    #[default]
    None,
    /// As the body; the text is in the header fields.
    Body,
    /// As a form: the members of `json` as its fields, or `body` as the field `body`; the picture
    /// as `attachment`.
    Form,
}

impl Target {
    pub fn wants(&self, rule: Rule) -> bool {
        rule == Rule::Test || self.on.as_ref().is_none_or(|rules| rules.contains(&rule))
    }

    fn templates(&self) -> Vec<&str> {
        let mut texts: Vec<&str> = self
            .url
            .iter()
            .chain(&self.body)
            .map(String::as_str)
            .collect();
        texts.extend(self.headers.values().map(String::as_str));
        texts.extend(self.command.iter().map(String::as_str));
        if let Some(json) = &self.json {
            template::texts(json, &mut texts);
        }
        texts
    }

    fn check(&self) -> Result<(), String> {
        let ways = [
            self.url.is_some(),
            self.topic.is_some(),
            !self.command.is_empty(),
        ];
        if ways.iter().filter(|way| **way).count() != 1 {
            return refused("it needs exactly one of `url`, `topic` and `command`");
        }
        for text in self.templates() {
            template::check(text)?;
        }
        let wants_token = self.templates().iter().any(|text| text.contains("{token}"));
        let has_token = self.token_file.is_some();
        if wants_token && !has_token {
            return refused("`{token}` needs `token_file`");
        }
        if has_token && !wants_token {
            return refused("its token is not used: write {token} where it belongs");
        }
        if let Some(url) = &self.url {
            let known = url.starts_with("https://") || url.starts_with("http://");
            if !known && !url.starts_with('{') {
                return refused("its url must begin with https:// or http://");
            }
        }
        if self.body.is_some() && self.json.is_some() {
            return refused("it has both `body` and `json`; one of them is sent");
        }
        match &self.topic {
            Some(topic) => self.check_topic(topic, has_token),
            None if self.url.is_none() && has_token => {
                refused("a command cannot have a token: it would show in lists of processes")
            }
            None => Ok(()),
        }
    }

    fn check_topic(&self, topic: &str, has_token: bool) -> Result<(), String> {
        let plain = |c: char| !c.is_control() && !matches!(c, '+' | '#' | '{' | '}');
        let good = !topic.is_empty() && topic.len() <= LONGEST_TOPIC && !topic.starts_with('$');
        if !good || !topic.chars().all(plain) {
            return Err(format!(
                "its topic must be one topic, such as `house/robot`, at most {LONGEST_TOPIC} bytes, \
                 without +, # and braces"
            ));
        }
        if has_token {
            return refused("a topic takes no token: the broker's is `mqtt.password_file`");
        }
        match self.picture {
            PictureMode::Form => refused("a topic takes a picture as `body` only, or none"),
            PictureMode::None | PictureMode::Body => Ok(()),
        }
    }
}

fn refused(why: &str) -> Result<(), String> {
    Err(why.to_owned())
}

impl Options {
    /// Returns the first target, by name, that needs the broker of `mqtt:`.
    pub fn needs_broker(&self) -> Option<&str> {
        let mut targets = self.targets.iter();
        targets.find_map(|(name, target)| target.topic.as_ref().map(|_| name.as_str()))
    }

    /// Checks what the types cannot express.
    pub fn check(&self) -> Result<(), String> {
        if self.targets.len() > MAX_TARGETS {
            return Err(format!("notify: at most {MAX_TARGETS} targets"));
        }
        for (name, target) in &self.targets {
            let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
            if name.is_empty() || name.len() > LONGEST_NAME || !name.chars().all(plain) {
                return Err(format!(
                    "notify.targets: the name `{name}` may have letters, digits, - and _, at most \
                     {LONGEST_NAME}"
                ));
            }
            let placed = |why| format!("notify.targets.{name}: {why}");
            target.check().map_err(placed)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(target: &str) -> Result<(), String> {
        let text = format!("targets:\n  phone: {target}\n");
        let options: Options = serde_yaml::from_str(&text).map_err(|error| error.to_string())?;
        options.check()
    }

    #[test]
    fn an_invalid_target_is_refused_with_an_explanation() {
        for (target, words) in [
            ("{}", "one of `url`, `topic` and `command`"),
            ("{ url: 'http://a', command: [x] }", "one of `url`"),
            ("{ url: 'http://a', topic: a }", "one of `url`"),
            ("{ topic: 'house/+' }", "one topic"),
            ("{ topic: 'house/{robot}' }", "one topic"),
            ("{ topic: '$SYS/a' }", "one topic"),
            ("{ topic: a, picture: form }", "`body` only"),
            (
                "{ topic: a, body: '{token}', token_file: a }",
                "mqtt.password_file",
            ),
            ("{ url: 'ftp://a' }", "https://"),
            ("{ url: 'http://a/{token}' }", "needs `token_file`"),
            ("{ url: 'http://a', token_file: a }", "is not used"),
            ("{ url: 'http://a', body: '{tetx}' }", "{tetx}"),
            (
                "{ url: 'http://a', json: { a: [{ b: '{secret}' }] } }",
                "{secret}",
            ),
            ("{ url: 'http://a', body: a, json: { a: b } }", "both"),
            (
                "{ command: [x, '{token}'], token_file: a }",
                "lists of processes",
            ),
            ("{ url: 'http://a', on: [fire] }", "fire"),
        ] {
            let error = checked(target).unwrap_err();
            assert!(error.contains(words), "{target}: {error}");
        }
        checked("{ url: 'https://a/{token}', token_file: a, on: [alarm, script] }").unwrap();
        checked("{ command: [notify-send, '{robot}', '{text}'] }").unwrap();
        checked("{ topic: house/robot, json: { says: '{text}' }, picture: body }").unwrap();
    }
}
