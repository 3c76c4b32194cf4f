//! Names that others chose, with markup, control characters, formulas and SQL, as they appear in
//! terminals, pages, metrics, spreadsheets and tables.

use rusqlite::Connection;
use rustix::process::Signal;
use serde_json::Value;
use spykee::sim::{Options, World};

use crate::live::browser::{address, ask, get};
use crate::rig::{QUIET_WORLD, Rig};

/// Names of robots, as their login may report them.
const ROBOTS: &[&str] = &[
    "=HYPERLINK(\"http://evil\")",
    "+1+1",
    "-1+1",
    "@SUM(A1)",
    "\t=1+1",
    "\u{ff1d}1+1",
    "a,b;c\"d",
    "<img src=x onerror=alert(1)>",
    "\u{1b}[2J\u{1b}]0;title\u{7}",
    "\u{202e}lortap",
    "../../#/+",
    "x'); DROP TABLE event;--",
    "{{ 7 * 7 }}",
    "a\"} 1\nspykee_forged 1",
    "${jndi:ldap://evil}",
    "a\nb\rc",
];
/// Names of behaviours, as files may be called.
const BEHAVIOURS: &[&str] = &[
    "=1+1",
    "+1",
    "-1",
    "@SUM(A1)",
    "a,b;c\"d",
    "<b onmouseover=alert(1)>",
    "x'); DROP TABLE event;--",
    "{{7*7}}",
    "$(touch pwned)",
    "#+",
    "a&amp;b",
    "%2e%2e",
    "\u{ff1d}1",
];

/// The cells of a CSV line.
fn cells(line: &str) -> Vec<String> {
    let mut cells = Vec::new();
    let mut cell = String::new();
    let mut quoted = false;
    for letter in line.chars() {
        match letter {
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(std::mem::take(&mut cell)),
            letter => cell.push(letter),
        }
    }
    cells.push(cell);
    cells
}

fn harmless(what: &str, text: &str) {
    let bad = |c: char| c != '\n' && c != '\t' && c.is_control() || c == '\u{202e}';
    assert!(!text.contains(bad), "{what}: {text:?}");
}

fn is_no_formula(cell: &str) -> bool {
    !cell.starts_with([
        '=', '+', '-', '@', '\t', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}',
    ])
}

/// All outputs about a run with this robot and this behaviour.
async fn told(uid: &str, behaviour: &str) {
    let what = format!("{uid:?} {behaviour:?}");
    let options = Options {
        uid: uid.to_owned(),
        ..Options::default()
    };
    let rig = Rig::with(
        World::from_yaml(QUIET_WORLD, "test world").unwrap(),
        options,
    )
    .await;
    let file = format!("{behaviour}.lua");
    rig.file(
        &file,
        "journal.add('seen', {what = '=1+1'}) print('ready') task.wait(600)",
    );
    rig.file("spykee.yaml", "data: data\njournal: { record: on }\n");
    // A file whose name begins with a dash needs `./`, as in any shell.
    let file = format!("./{file}");
    let args = [
        "run",
        &*file,
        "--robot",
        &rig.address,
        "--config",
        "spykee.yaml",
        "--live=127.0.0.1:0",
    ];
    let mut run = rig.spykee(&args);
    let at = address(&run).await;
    run.says("ready").await;
    let (status, state) = get(&at, "/api/status").await;
    assert_eq!(status, 200, "{what}");
    serde_json::from_str::<Value>(&state)
        .unwrap_or_else(|error| panic!("{what}: {error}: {state}"));
    let (_, metrics) = get(&at, "/metrics").await;
    assert!(
        metrics
            .lines()
            .all(|line| line.starts_with("# ") || line.starts_with("spykee_")),
        "{what}: {metrics}"
    );
    assert!(!metrics.contains("forged"), "{what}: {metrics}");
    let (_, list) = get(&at, "/api/behaviours").await;
    let list: Value = serde_json::from_str(&list).unwrap();
    assert_eq!(list["behaviours"][0]["name"], behaviour, "{what}");
    let (status, answer) = ask(
        &at,
        "POST /api/behaviour",
        "",
        "{\"name\":\"nobody\",\"change\":\"stop\"}",
    )
    .await;
    assert_eq!(status, 409, "{what}: {answer}");
    for args in [&["status"][..], &["behaviour", "list"]] {
        let mut asked = rig.spykee(args);
        asked.code().await;
        harmless(&format!("{what} {args:?}"), &asked.text());
    }
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(130), "{what}: {}", run.text());
    harmless(&what, &run.text());
    for args in [&["all"][..], &["runs"], &["link"], &["entries"]] {
        let mut table = rig.spykee(&[&["history", "--config", "spykee.yaml"], args].concat());
        assert_eq!(table.code().await, Some(0), "{what}: {}", table.text());
        harmless(&what, &table.text());
        let mut csv =
            rig.spykee(&[&["history", "--config", "spykee.yaml", "--csv"], args].concat());
        assert_eq!(csv.code().await, Some(0), "{what}: {}", csv.text());
        let text = csv.text();
        harmless(&what, &text);
        let width = cells(text.lines().next().unwrap()).len();
        for line in text.lines() {
            let cells = cells(line);
            assert_eq!(cells.len(), width, "{what}: {line}");
            assert!(
                cells.iter().all(|cell| is_no_formula(cell)),
                "{what}: {line}"
            );
        }
    }
    let journal = Connection::open(rig.folder().join("data/.journal/journal.db")).unwrap();
    let kept = "SELECT count(*) FROM event WHERE kind = 'started' AND behaviour = ?";
    let kept: i64 = journal
        .query_row(kept, [behaviour], |row| row.get(0))
        .unwrap();
    assert_eq!(kept, 1, "{what}");
    assert!(!rig.folder().join("pwned").exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn names_of_robots_and_behaviours_are_plain_text_in_all_outputs() {
    let most = ROBOTS.len().max(BEHAVIOURS.len());
    for number in 0..most {
        told(
            ROBOTS[number % ROBOTS.len()],
            BEHAVIOURS[number % BEHAVIOURS.len()],
        )
        .await;
    }
}
