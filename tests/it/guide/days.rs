//! The config of the book in a flat in which somebody walks: an evening for each change, three whole days
//! with `NIGHTLY=1`, in virtual time. Prints a table; afterwards the journal is read as people would.

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::path::Path;
use std::process::Stdio;

use rustix::process::Signal;
use serde_json::Value;
use spykee::sim::World;
use spykee::vision::{Decoder, Image, brightness};

use super::chapter;
use crate::live::get;
use crate::mqtt::{Broker, Subscriber};
use crate::rig::{Run, assert_contains, exact_yaml, run_in, sized};

const DAY: f64 = 24.0 * 3600.0;
/// Home after the time of a patrol is over, in seconds: the service waits for a minute first.
const HOME: f64 = 300.0;
/// Rows of a picture of 240 in which somebody can be seen, at least. A whole person is cut by the upper
/// border, and 140 rows high.
const VISIBLE: u32 = 60;
/// Brightness of 0 to 1: a picture without light has 0.01.
const NOT_BLACK: f64 = 0.05;

/// The hall, where Ada wears what nothing else has the colour of. In the room of the patrol it is light from
/// six to eight; where she walks there is always a lamp. Two pictures a second are enough for the guard.
fn flat(dark_after: f64) -> String {
    let hall = exact_yaml("hall");
    let lamps = format!(
        "light: 0.05\nlamps:\n\
         - {{ name: day, at: [1.6, 3], brightness: 0.9, reach: 5, \
         off: {{ after: {dark_after}, for: 36000, every: 86400 }} }}\n\
         - {{ name: hall, at: [4.8, 2.8], brightness: 0.9, reach: 1.5 }}\n\
         camera: {{ fps: 2 }}\n"
    );
    let ada = "colour: \"#7a4a52\"";
    assert!(hall.contains(ada));
    format!("{}{lamps}", hall.replace(ada, "colour: magenta"))
}

/// What a day was like.
#[derive(Debug, Default)]
struct Day {
    patrols: u32,
    home: u32,
    /// Seconds off the station.
    out: f64,
    alarms: u32,
    /// Alarms with a picture in which she can be seen.
    seen: u32,
    /// Of pictures of the patrol after eight: brightness, 0 to 1.
    evening: Vec<f64>,
    /// Starts, ends, dockings and standstills in the journal, and how many say who and why.
    rows: u32,
    explained: u32,
    /// Pictures of alarms in the page's gallery.
    gallery: u32,
}

struct Flat {
    folder: tempfile::TempDir,
    /// The first date, and the seconds of it after which it begins.
    date: i8,
    begins: f64,
}

impl Flat {
    fn new(date: i8, begins: f64) -> Flat {
        let folder = tempfile::tempdir().unwrap();
        let ready = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours");
        for name in ["guard.lua", "patrol.lua", "greet.lua"] {
            std::fs::copy(ready.join(name), folder.path().join(name)).unwrap();
        }
        let config = chapter("operate/service-rules.md").blocks("yaml")[0];
        let flat = Flat {
            folder,
            date,
            begins,
        };
        // In virtual time a service keeps a journal only if it is told to.
        flat.file(
            "spykee.yaml",
            &format!("{config}journal: {{ record: on }}\n"),
        );
        flat.file("flat.yaml", &flat_world(begins));
        flat
    }

    fn file(&self, name: &str, text: &str) {
        std::fs::write(self.folder.path().join(name), text).unwrap();
    }

    fn run(&self, command: &str, more: &[&str]) -> String {
        let words: Vec<&str> = command.split(' ').chain(more.iter().copied()).collect();
        let ended = run_in(self.folder.path(), &words);
        assert_eq!(ended.code, Some(0), "{command}: {}", ended.text());
        ended.out
    }

    /// Lets so many hours pass; returns the events, each with its time.
    fn passes(&self, hours: f64, seed: u64) -> Vec<(f64, Value)> {
        let seconds = (hours * 3600.0).to_string();
        let clock = self.begins as u64;
        let time = format!(
            "{:02}:{:02}:{:02}",
            clock / 3600,
            clock / 60 % 60,
            clock % 60
        );
        let date = format!("2026-05-{:02} {time}", self.date);
        let seed = seed.to_string();
        let more = ["--for", &seconds, "--date", &date, "--seed", &seed];
        let serve = "serve --config spykee.yaml --sim flat.yaml --fast --events events.jsonl";
        self.run(serve, &more);
        let events = std::fs::read_to_string(self.folder.path().join("events.jsonl")).unwrap();
        let events = events.lines().map(|line| {
            let event: Value = serde_json::from_str(line).unwrap();
            (event["t"].as_f64().unwrap(), event)
        });
        events.collect()
    }

    fn day_of(&self, seconds: f64) -> i8 {
        self.date + ((self.begins + seconds) / DAY) as i8
    }
}

fn flat_world(begins: f64) -> String {
    let yaml = flat((20.0 * 3600.0 - begins).max(0.0));
    World::from_yaml(&yaml, "flat").unwrap();
    yaml
}

fn picture(path: &str) -> Image {
    let jpeg = std::fs::read(path).unwrap_or_else(|_| panic!("no picture {path}"));
    Decoder::default().decode(&jpeg).unwrap().clone()
}

/// Whether somebody in magenta can be seen.
fn shows_her(image: &Image) -> bool {
    let pixels = image.to_rgb();
    let rows = pixels.rows().filter(|row| {
        let hers = row.clone().filter(|pixel| {
            let [r, g, b] = pixel.0;
            r.min(b) > g.saturating_add(25)
        });
        hers.count() >= 2
    });
    rows.count() as u32 >= VISIBLE
}

/// The path in a line of the log such as `alarm 1: something moves picture=/tmp/1.jpg`.
fn saved(event: &Value) -> Option<&str> {
    event["text"]
        .as_str()?
        .split_once("picture=")
        .map(|(_, path)| path)
}

fn judge(flat: &Flat, events: &[(f64, Value)]) -> BTreeMap<i8, Day> {
    let mut days: BTreeMap<i8, Day> = BTreeMap::new();
    let text = |event: &Value| event["text"].as_str().unwrap_or_default().to_owned();
    let next = |from: f64, wanted: &str| {
        let mut later = events.iter().filter(|(at, _)| *at >= from);
        later
            .find(|(_, event)| text(event).starts_with(wanted))
            .map(|(at, _)| *at)
    };
    for (at, event) in events {
        let day = days.entry(flat.day_of(*at)).or_default();
        let hour = (flat.begins + at) % DAY / 3600.0;
        let (by, text) = (event["behaviour"].as_str(), text(event));
        if by == Some("patrol") && text.starts_with("starts by the timetable") {
            day.patrols += 1;
            let over = next(*at, "its time is over").expect("the patrol goes on");
            let home = next(over, "Engine(Docked)").expect("it is not at home");
            day.home += u32::from(home - over < HOME);
            day.out += home - at;
        } else if by == Some("guard") && text.contains("something moves") {
            day.alarms += 1;
            day.seen += u32::from(shows_her(&picture(saved(event).unwrap())));
        } else if by == Some("patrol") && hour > 20.0 && saved(event).is_some() {
            day.evening
                .push(brightness(&picture(saved(event).unwrap()), None));
        }
    }
    days
}

/// Whether a row of the journal says who or what, and why.
fn is_explained(row: &Value) -> bool {
    let says = |key: &str| row[key].as_str().is_some_and(|text| !text.is_empty());
    match row["event"].as_str().unwrap() {
        "started" => says("by"),
        // The service's own end is the reason.
        "ended" => says("reason") && (says("by") || row["reason"] != "cancelled"),
        "dock" | "undock" => says("by") && says("end"),
        _ => says("reason"),
    }
}

fn add_history(flat: &Flat, days: &mut BTreeMap<i8, Day>) {
    let said = flat.run(
        "history --config spykee.yaml --json --since 2026-04-30",
        &[],
    );
    let rows: Vec<Value> = serde_json::from_str(&said).unwrap();
    let kinds = ["started", "ended", "dock", "undock", "standstill"];
    for row in rows
        .iter()
        .filter(|row| kinds.iter().any(|kind| row["event"] == *kind))
    {
        let at: jiff::Timestamp = row["at"].as_str().unwrap().parse().unwrap();
        let zone = jiff::tz::TimeZone::get("Europe/Rome").unwrap();
        let day = days.entry(at.to_zoned(zone).day()).or_default();
        day.rows += 1;
        assert!(is_explained(row), "{row}");
        day.explained += 1;
    }
}

/// The service goes on in real time, a few seconds before a patrol: its page has the pictures and rows of
/// the days before, in two taps, and the broker says who starts and ends the next patrol.
async fn add_page(flat: &Flat, days: &mut BTreeMap<i8, Day>) {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = free.local_addr().unwrap().to_string();
    drop(free);
    let broker = Broker::start();
    let mqtt = broker.as_ref().map(Broker::config).unwrap_or_default();
    let config = std::fs::read_to_string(flat.folder.path().join("spykee.yaml")).unwrap();
    // The command line would look for a service with the config's robot.
    let config = config.replace("robot: 172.17.6.1\n", "");
    flat.file(
        "spykee.yaml",
        &format!("{config}live: {{ listen: {at} }}\n{mqtt}"),
    );
    let subscriber = match &broker {
        Some(broker) => Some(Subscriber::connect(broker).await),
        None => None,
    };
    let last = *days.keys().last().unwrap();
    let date = format!("2026-05-{:02} 20:59:55", last + 1);
    let serve = "serve --config spykee.yaml --sim flat.yaml --date";
    let serve: Vec<&str> = serve.split(' ').chain([&date[..]]).collect();
    let mut run = Run::start(&serve, flat.folder.path(), Stdio::null(), &[]);
    run.says("the page is at").await;
    for (date, day) in days.iter_mut() {
        // The gallery of the day, and then its first picture.
        let zone = jiff::tz::TimeZone::get("Europe/Rome").unwrap();
        let midnight = jiff::civil::date(2026, 5, *date).to_zoned(zone).unwrap();
        let since = midnight.timestamp().as_millisecond();
        let until = since + 24 * 3600 * 1000;
        let gallery = read(&at, &format!("/api/pictures?since={since}&until={until}")).await;
        let alarms = gallery["alarms"].as_array().unwrap();
        day.gallery = alarms.len() as u32;
        for alarm in alarms {
            let name = alarm["name"].as_str().unwrap();
            let path = format!("/api/behaviours/guard/pictures/{name}");
            let (status, _) = get(&at, &path).await;
            assert_eq!(status, 200, "{path}");
            assert_eq!(alarm["text"], "something moves");
        }
    }
    let history = read(&at, "/api/history?days=7").await;
    let events = history["events"].as_array().unwrap();
    let is = |event: &&Value, kind: &str| event["kind"] == kind && event["behaviour"] == "patrol";
    let patrols: u32 = days.values().map(|day| day.patrols).sum();
    let starts = events.iter().filter(|event| is(event, "started"));
    let starts = starts
        .filter(|event| event["text"] == "the timetable")
        .count();
    let ends = events.iter().filter(|event| is(event, "ended"));
    let ends = ends
        .filter(|event| event["text"] == "its time is over")
        .count();
    assert!(
        starts as u32 >= patrols && ends as u32 == patrols,
        "{history}"
    );
    if let Some(subscriber) = &subscriber {
        says_who(subscriber, "started", "the timetable").await;
        flat.run("behaviour stop patrol", &[]);
        says_who(subscriber, "ended", "the command line").await;
    }
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

async fn read(at: &str, path: &str) -> Value {
    let (status, body) = get(at, path).await;
    assert_eq!(status, 200, "{path}: {body}");
    serde_json::from_str(&body).unwrap()
}

/// Waits until the broker says who has started or ended the patrol.
async fn says_who(subscriber: &Subscriber, kind: &str, by: &str) {
    let event = subscriber
        .wait_for(0, "spykee/SPYKEE0001/event", |payload| {
            let event: Value = serde_json::from_slice(payload).unwrap();
            event["event_type"] == kind && event["behaviour"] == "patrol"
        })
        .await;
    assert_contains(&String::from_utf8_lossy(&event), &["\"by\":", by]);
}

/// After each patrol the robot is soon at home, although a guard is always on; who walks by while the patrol
/// stands and watches is reported with a picture of her, also in the evening; the page, the history and
/// the broker say what happened, who and why.
#[tokio::test(flavor = "multi_thread")]
async fn what_the_book_promises_for_a_day_happens() {
    let (begins, hours) = sized((20.0 * 3600.0 + 3570.0, 2.0 / 3.0), (6.0 * 3600.0, 72.0));
    let flat = Flat::new(1, begins);
    let events = flat.passes(hours, 1);
    let mut days = judge(&flat, &events);
    days.retain(|_, day| day.patrols > 0);
    add_history(&flat, &mut days);
    days.retain(|_, day| day.patrols > 0);
    add_page(&flat, &mut days).await;
    println!(
        "| day | patrols | home within 5 min | she walked past the door | alarms | she is in the picture | \
         pictures in the evening: darkest, median | alarms on the page | rows with who and why |"
    );
    for (date, day) in &mut days {
        day.evening.sort_by(f64::total_cmp);
        let darkest = *day.evening.first().unwrap();
        let median = day.evening[day.evening.len() / 2];
        println!(
            "| 2026-05-{date:02} | {} | {} | {:.0} | {} | {} | {:.0}, {:.0} of 255 | {} | {} of {} |",
            day.patrols,
            day.home,
            // Once round in 32 s, both ways past the door.
            day.out / 16.0,
            day.alarms,
            day.seen,
            255.0 * darkest,
            255.0 * median,
            day.gallery,
            day.explained,
            day.rows,
        );
        assert_eq!(day.home, day.patrols);
        assert_eq!(day.patrols, sized(1, 2));
        assert!(day.seen >= day.patrols, "nobody was reported");
        // At the edge of the picture she may be gone in the next one.
        assert!(5 * day.seen >= 4 * day.alarms, "alarms without anybody");
        assert!(day.gallery > 0 && day.gallery <= day.alarms);
        assert!(darkest > NOT_BLACK, "a black picture");
    }
    assert_eq!(days.len(), sized(1, 3));
}
