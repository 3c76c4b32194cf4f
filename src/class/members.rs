//! Who is in the class: the word, names, devices and their admission, and what the teacher sees of
//! each learner. Pure: the time is an argument, and nothing here waits or opens a file.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::time::Duration;

use data_encoding::HEXLOWER;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use tokio::time::Instant;

use crate::behaviour::validate_name;
use crate::rate_limit::TokenBucket;

/// The name of the teacher's own workspace, which no learner can have.
pub(super) const TEACHER: &str = "teacher";
/// Longest name, in characters.
const LONGEST_NAME: usize = 24;
/// Maximum number of learners, of a learner's devices, and of devices that wait for the teacher.
const MAX_LEARNERS: usize = 200;
const MAX_DEVICES: usize = 4;
const MAX_WAITING: usize = 40;
/// Wrong words of one address: so many at once, and then so many per second.
const WRONG_WORDS: f64 = 10.0;
const WRONG_WORDS_RATE: f64 = 0.1;
/// Maximum number of addresses whose wrong words are counted.
const MAX_ADDRESSES: usize = 1024;
/// After this time without a keystroke, a run or a check, a learner who is there counts as idle.
pub(super) const IDLE: Duration = Duration::from_secs(300);
/// The same error so often in a row is shown to the teacher.
const SAME_ERROR: u32 = 3;

/// What is kept of a learner from one day to the next: nothing else about a person is stored.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Record {
    /// The digests of the cookies of the devices that the teacher has admitted.
    devices: Vec<String>,
    /// The best points by lesson.
    pub(super) points: BTreeMap<String, u64>,
}

/// The newest run of a learner.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(super) struct RunState {
    /// Counts the runs, so that the page knows a new one.
    pub(super) number: u64,
    /// Whether there is a simulated robot.
    pub(super) open: bool,
    /// Whether its script runs.
    pub(super) running: bool,
    pub(super) place: String,
    pub(super) world: String,
    /// Why its script failed.
    pub(super) error: Option<String>,
}

#[derive(Debug, Default)]
pub(super) struct Member {
    pub(super) record: Record,
    /// Number of open pages.
    pub(super) pages: usize,
    /// When the learner last typed, ran or checked something.
    active: Option<Instant>,
    /// The lesson, or `free`, that the learner last opened.
    pub(super) place: String,
    pub(super) run: RunState,
    /// The newest check: lesson, points, what is missing.
    pub(super) check: Option<Value>,
    pub(super) checking: bool,
    /// Counts the changes of the learner's files.
    pub(super) edits: u64,
    last_error: String,
    same_errors: u32,
}

impl Member {
    pub(super) fn act(&mut self, now: Instant) {
        self.active = Some(now);
    }

    /// Notes how a run or a check has ended.
    pub(super) fn note_result(&mut self, error: Option<&str>) {
        // Other lines move an error, but it is the same.
        let text = error.unwrap_or_default().lines().next().unwrap_or_default();
        let text = text.replace(|c: char| c.is_ascii_digit(), "");
        let repeats = text == self.last_error && !text.is_empty();
        self.same_errors = match (repeats, text.is_empty()) {
            (true, _) => self.same_errors + 1,
            (false, empty) => u32::from(!empty),
        };
        self.last_error = text;
    }

    fn idle(&self, now: Instant) -> bool {
        let active = self.active.is_some_and(|at| now.duration_since(at) < IDLE);
        self.pages > 0 && !active
    }

    fn flags(&self, now: Instant) -> Vec<&'static str> {
        let stuck = self.same_errors >= SAME_ERROR;
        let flags = [(stuck, "same_error"), (self.idle(now), "idle")];
        let raised = flags.into_iter().filter(|flag| flag.0);
        raised.map(|flag| flag.1).collect()
    }

    /// What the wall shows of the learner.
    pub(super) fn tile(&self, name: &str, now: Instant) -> Value {
        let sentence = self.check.as_ref().map(|check| check["sentence"].clone());
        json!({
            "name": name, "present": self.pages > 0, "points": self.record.points, "place": self.place,
            "run": self.run, "sentence": sentence, "checking": self.checking, "edits": self.edits,
            "flags": self.flags(now),
        })
    }
}

/// A device that waits for the teacher.
#[derive(Debug, Clone, PartialEq, Eq)]
struct WaitingDevice {
    id: u32,
    name: String,
    digest: String,
}

/// Whose a request is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Device {
    Admitted(String),
    Waiting(String),
    Unknown,
}

/// Why somebody cannot join; a sentence for the person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum JoinError {
    #[error("this is not the class word: it is on the wall")]
    Word,
    #[error("too many wrong class words: wait a minute")]
    TooMany,
    #[error("a name has 1 to 24 letters, digits and signs, and does not begin with a dot")]
    Name,
    #[error("the class is full")]
    Full,
}

/// The class: its word, its learners, and the devices that wait.
#[derive(Debug, Default)]
pub(super) struct Members {
    word: String,
    pub(super) learners: BTreeMap<String, Member>,
    waiting: Vec<WaitingDevice>,
    next_id: u32,
    wrong: HashMap<IpAddr, TokenBucket>,
}

impl Members {
    pub(super) fn new(word: &str, records: BTreeMap<String, Record>) -> Members {
        let member = |record| Member {
            record,
            ..Member::default()
        };
        let learners = records
            .into_iter()
            .map(|(name, record)| (name, member(record)));
        Members {
            word: normal(word),
            learners: learners.collect(),
            ..Members::default()
        }
    }

    /// Adds a name of the teacher's list, if it can be the name of a folder.
    pub(super) fn expect(&mut self, name: &str) -> Result<(), JoinError> {
        let name = self.name(name)?;
        self.learners.entry(name).or_default();
        Ok(())
    }

    /// A device asks to be admitted under a name. It has this cookie from now on.
    pub(super) fn join(
        &mut self,
        word: &str,
        name: &str,
        cookie: &str,
        from: IpAddr,
        now: Instant,
    ) -> Result<(), JoinError> {
        if self.wrong.len() >= MAX_ADDRESSES {
            self.wrong.clear();
        }
        let bucket = || TokenBucket::new(WRONG_WORDS, WRONG_WORDS_RATE);
        let wrong = self.wrong.entry(from).or_insert_with(bucket);
        if !wrong.take(1.0, now) {
            return Err(JoinError::TooMany);
        }
        if normal(word) != self.word {
            return Err(JoinError::Word);
        }
        self.wrong.remove(&from);
        let name = self.name(name)?;
        if !self.learners.contains_key(&name) && self.learners.len() >= MAX_LEARNERS {
            return Err(JoinError::Full);
        }
        self.next_id += 1;
        self.waiting.push(WaitingDevice {
            id: self.next_id,
            name,
            digest: digest(cookie),
        });
        let surplus = self.waiting.len().saturating_sub(MAX_WAITING);
        self.waiting.drain(..surplus);
        Ok(())
    }

    /// The name as it is known, or as given if it is new.
    fn name(&self, given: &str) -> Result<String, JoinError> {
        let name = given.trim();
        let long = name.chars().count() > LONGEST_NAME;
        let same = |known: &&String| known.to_lowercase() == name.to_lowercase();
        if validate_name(name).is_err() || long || same(&&TEACHER.to_owned()) {
            return Err(JoinError::Name);
        }
        let known = self.learners.keys().find(same);
        Ok(known.cloned().unwrap_or_else(|| name.to_owned()))
    }

    /// Admits a device that waits, or sends it away. Returns whether there was one.
    pub(super) fn decide(&mut self, id: u32, admit: bool) -> bool {
        let Some(at) = self.waiting.iter().position(|one| one.id == id) else {
            return false;
        };
        let device = self.waiting.remove(at);
        if admit {
            let member = self.learners.entry(device.name).or_default();
            let devices = &mut member.record.devices;
            devices.push(device.digest);
            let surplus = devices.len().saturating_sub(MAX_DEVICES);
            devices.drain(..surplus);
        }
        true
    }

    /// Sends away all devices of a learner: somebody else has used the name.
    pub(super) fn dismiss(&mut self, name: &str) -> bool {
        let member = self.learners.get_mut(name);
        member.map(|member| member.record.devices.clear()).is_some()
    }

    pub(super) fn device(&self, cookie: &str) -> Device {
        let digest = digest(cookie);
        let has = |member: &Member| member.record.devices.contains(&digest);
        if let Some((name, _)) = self.learners.iter().find(|(_, member)| has(member)) {
            return Device::Admitted(name.clone());
        }
        let waits = self.waiting.iter().find(|one| one.digest == digest);
        waits.map_or(Device::Unknown, |one| Device::Waiting(one.name.clone()))
    }

    /// The devices that wait, for the teacher: whether the name has a device already, or is new.
    pub(super) fn waiting(&self) -> Value {
        let known = |name: &str| self.learners.get(name);
        let waits = |one: &WaitingDevice| {
            let member = known(&one.name);
            let again = member.is_some_and(|member| !member.record.devices.is_empty());
            json!({ "id": one.id, "name": one.name, "again": again, "new": member.is_none() })
        };
        self.waiting.iter().map(waits).collect()
    }

    pub(super) fn records(&self) -> BTreeMap<&str, &Record> {
        let records = self.learners.iter();
        records
            .map(|(name, member)| (name.as_str(), &member.record))
            .collect()
    }
}

/// The class word as people type it: with any spaces, hyphens and capital letters.
fn normal(word: &str) -> String {
    let letters = word.chars().filter(|c| c.is_alphabetic());
    letters.flat_map(char::to_lowercase).take(100).collect()
}

fn digest(cookie: &str) -> String {
    HEXLOWER.encode(&Sha256::digest(cookie.as_bytes()))
}

/// Three plain words, of 64 each: nobody guesses them with ten tries.
pub(super) fn class_word(random: [u8; 3]) -> String {
    const WORDS: &str = "apple arrow badge basil beach berry bird boat book bread brick bridge \
        cable candle castle cherry cloud clover coral daisy desert dragon drum eagle feather field \
        flute forest garden ginger guitar hammer harbor honey island jungle kettle lemon lion maple \
        market meadow melon moon nest ocean olive orange paper pepper piano planet pumpkin rabbit \
        river robin rocket salt silver spoon star tiger tulip window";
    let words: Vec<&str> = WORDS.split_whitespace().collect();
    random
        .map(|one| words[usize::from(one) % words.len()])
        .join(" ")
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand::rngs::StdRng;

    use super::*;

    const HERE: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

    fn members() -> Members {
        Members::new("apple river star", BTreeMap::new())
    }

    fn join(members: &mut Members, name: &str, cookie: &str) -> Result<(), JoinError> {
        members.join("Apple-River  STAR", name, cookie, HERE, Instant::now())
    }

    #[test]
    fn a_device_belongs_to_a_name_once_the_teacher_says_so() {
        let mut members = members();
        join(&mut members, "Ada", "one").unwrap();
        assert_eq!(members.device("one"), Device::Waiting("Ada".to_owned()));
        assert!(members.decide(1, true));
        assert_eq!(members.device("one"), Device::Admitted("Ada".to_owned()));
        assert_eq!(members.device("two"), Device::Unknown);
        // A second device for the name, written otherwise, asks the teacher again.
        join(&mut members, " ada ", "two").unwrap();
        assert_eq!(members.device("two"), Device::Waiting("Ada".to_owned()));
        assert_eq!(members.waiting()[0]["again"], true);
        assert!(members.decide(2, false));
        assert_eq!(members.device("two"), Device::Unknown);
        assert!(!members.decide(2, true), "it was sent away");
        assert!(members.dismiss("Ada"));
        assert_eq!(members.device("one"), Device::Unknown);
    }

    #[test]
    fn a_name_is_also_that_of_a_folder_and_never_the_teachers() {
        let mut members = members();
        let long = "x".repeat(25);
        for bad in [
            "",
            " ",
            ".",
            "..",
            ".class",
            "../ada",
            "a/b",
            "a\\b",
            "a:b",
            "a\0",
            "a\nb",
            "a\u{202e}b",
            "\x1b[31m",
            "Teacher",
            &long,
        ] {
            assert_eq!(
                join(&mut members, bad, "x"),
                Err(JoinError::Name),
                "{bad:?}"
            );
        }
        for good in [
            "Ada",
            "Zoë",
            "Max 2",
            "O'Neil",
            "<b>Bo</b>"[..4].trim(),
            "李",
        ] {
            assert_eq!(join(&mut members, good, "x"), Ok(()), "{good:?}");
        }
    }

    #[test]
    fn words_cannot_be_tried_for_long_and_the_right_one_no_longer_counts_then() {
        let mut members = members();
        let now = Instant::now();
        let mut guess = |word: &str, at| members.join(word, "Eve", "x", HERE, at);
        for _ in 0..10 {
            assert_eq!(guess("lemon", now), Err(JoinError::Word));
        }
        assert_eq!(guess("apple river star", now), Err(JoinError::TooMany));
        let later = now + Duration::from_secs(60);
        assert_eq!(guess("apple river star", later), Ok(()));
    }

    #[test]
    fn the_same_error_three_times_and_five_idle_minutes_are_flagged() {
        let now = Instant::now();
        let mut member = Member {
            pages: 1,
            ..Member::default()
        };
        member.act(now);
        for line in 3..6 {
            assert!(member.flags(now).is_empty());
            member.note_result(Some(&format!("moving.lua:{line}: no such call")));
        }
        assert_eq!(member.flags(now), ["same_error"]);
        member.note_result(None);
        assert!(member.flags(now).is_empty());
        assert_eq!(member.flags(now + IDLE), ["idle"]);
        member.pages = 0;
        assert!(
            member.flags(now + IDLE).is_empty(),
            "who is away is not idle"
        );
    }

    /// Whether the wall flags a session of forty runs; a stuck learner repeats an error in the end.
    fn is_flagged(number: u64) -> bool {
        let mut random = StdRng::seed_from_u64(number);
        let mut member = Member::default();
        let mut flagged = false;
        for at in 0..40 {
            let error = match (number < 6 && at >= 20, random.random_range(0..9)) {
                (true, _) => Some("x.lua:7: attempt to call a nil value".to_owned()),
                (false, 0..3) => None,
                (false, _) => Some(format!("error {}", random.random_range('a'..='z'))),
            };
            member.note_result(error.as_deref());
            flagged |= member.flags(Instant::now()).contains(&"same_error");
        }
        flagged
    }

    #[test]
    fn six_stuck_learners_of_thirty_are_found_and_at_most_one_other() {
        let flagged: Vec<bool> = (0..30).map(is_flagged).collect();
        assert!(flagged[..6].iter().all(|is| *is), "{flagged:?}");
        assert!(
            flagged[6..].iter().filter(|is| **is).count() <= 1,
            "{flagged:?}"
        );
    }

    proptest! {
        #[test]
        fn no_name_leaves_the_folder(name in "\\PC{0,30}|[./\\\\a]{1,6}") {
            let mut members = members();
            if join(&mut members, &name, "x").is_ok() {
                let Device::Waiting(name) = members.device("x") else { unreachable!() };
                let path = std::path::Path::new(&name);
                prop_assert_eq!(path.components().count(), 1);
                prop_assert!(!name.starts_with('.'));
            }
        }
    }
}
