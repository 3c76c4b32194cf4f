//! Journals from untrusted sources, and other things in the journal's place.

use std::os::unix::fs::symlink;
use std::path::Path;

use rusqlite::Connection;
use rustix::fs::{CWD, FileType, Mode, mknodat};

use super::{DRIVES, drove_on};
use crate::live::browser::{address, get};
use crate::rig::Rig;

const CONFIG: &str = "data: data\njournal: { record: on }\nbehaviours: [{ file: script.lua }]\n";
const SECRET: &str = "not for others";

/// Replaces or changes the journal's file, which is valid before. Beside the data folder there is a
/// private file.
type Tampering = fn(&Path, &Path);

fn sql(path: &Path, text: &str) {
    Connection::open(path).unwrap().execute_batch(text).unwrap();
}

/// Removes the journal's file and returns its path.
fn instead(path: &Path) -> &Path {
    std::fs::remove_file(path).unwrap();
    path
}

/// A query with an infinite number of rows.
const ENDLESS: &str = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)";

const TAMPERINGS: &[(&str, Tampering)] = &[
    ("a link to a private file", |path, private| {
        symlink(private, instead(path)).unwrap()
    }),
    ("a link to a journal elsewhere", |path, private| {
        let elsewhere = private.with_file_name("elsewhere.db");
        std::fs::rename(path, &elsewhere).unwrap();
        symlink(elsewhere, path).unwrap();
    }),
    ("a link to endless zeros", |path, _| {
        symlink("/dev/zero", instead(path)).unwrap()
    }),
    ("a link to itself", |path, _| {
        symlink("journal.db", instead(path)).unwrap()
    }),
    ("a folder", |path, _| {
        std::fs::create_dir(instead(path)).unwrap()
    }),
    ("a pipe", |path, _| {
        mknodat(
            CWD,
            instead(path),
            FileType::Fifo,
            Mode::RUSR | Mode::WUSR,
            0,
        )
        .unwrap()
    }),
    ("garbage", |path, _| {
        std::fs::write(path, vec![7; 100_000]).unwrap()
    }),
    ("a script", |path, _| {
        std::fs::write(path, "#!/bin/sh\nrm -rf /\n").unwrap()
    }),
    ("a sparse file", |path, _| {
        std::fs::File::create(path)
            .unwrap()
            .set_len(8 << 30)
            .unwrap();
    }),
    ("the head of a journal and garbage", |path, _| {
        let mut bytes = std::fs::read(path).unwrap();
        bytes.truncate(4096);
        bytes[100..].fill(0xff);
        std::fs::write(path, bytes).unwrap();
    }),
    ("half a journal", |path, _| {
        let bytes = std::fs::read(path).unwrap();
        std::fs::write(path, &bytes[..bytes.len() / 2 + 100]).unwrap();
    }),
    ("a journal of a newer version", |path, _| {
        sql(path, "PRAGMA user_version = 77")
    }),
    ("a journal whose log is a link", |path, private| {
        let _ = std::fs::remove_file(path.with_file_name("journal.db-wal"));
        symlink(private, path.with_file_name("journal.db-wal")).unwrap();
    }),
    ("a journal whose log is a folder", |path, _| {
        let log = path.with_file_name("journal.db-wal");
        let _ = std::fs::remove_file(&log);
        std::fs::create_dir(log).unwrap();
    }),
    ("another program's tables", |path, _| {
        sql(
            instead(path),
            "CREATE TABLE event (x); PRAGMA user_version = 1",
        )
    }),
    ("a journal whose reading never ends", |path, _| {
        sql(path, &format!(
            "DROP TABLE event; DROP TABLE battery; CREATE VIEW event AS {ENDLESS} SELECT i AS at, i AS session, 'x' AS robot, 'entry' AS kind,
                'x' AS behaviour, '{{}}' AS data, i AS rowid FROM n;
             CREATE VIEW battery AS {ENDLESS} SELECT i AS at, i AS session, 'x' AS robot, 1 AS percent,
                0 AS charging, i AS rowid FROM n"
        ));
    }),
    ("a journal whose writing never ends", |path, _| {
        sql(path, &format!(
        "CREATE TABLE sink (x);
         CREATE TRIGGER endless AFTER INSERT ON event BEGIN
            INSERT INTO sink SELECT a.rowid FROM event a, event b, event c, event d;
            INSERT INTO sink SELECT count(*) FROM (SELECT 1 FROM (VALUES {0}), (VALUES {0}), (VALUES {0}),
                (VALUES {0}), (VALUES {0}), (VALUES {0}), (VALUES {0}), (VALUES {0})); END;",
        ["(1)"; 60].join(",")
    ))
    }),
    ("a journal that deletes what is written", |path, _| {
        sql(
            path,
            "CREATE TRIGGER gone AFTER INSERT ON event BEGIN DELETE FROM event; END",
        )
    }),
    ("invalid rows", |path, _| {
        sql(
            path,
            "INSERT INTO event VALUES (NULL, 9223372036854775807, -1, x'ff', 'entry', x'00', x'ffff');
         INSERT INTO event VALUES (NULL, -9223372036854775808, 'a', NULL, 'dock', NULL, '[[[[');
         INSERT INTO battery VALUES ('soon', 1, NULL, 'full', 'yes');
         INSERT INTO battery VALUES (1767258000000, 1, NULL, 9223372036854775807, 7)",
        )
    }),
    ("rows with escape sequences", |path, _| {
        sql(path,
        "INSERT INTO event VALUES (NULL, 1767258000000, 1, char(27) || '[2J', 'entry', 'x',
            '{\"event\":\"entry\",\"behaviour\":\"\\u001b[2J\",\"kind\":\"\\u202e\",\"data\":{\"a\":\"=1+1\"}}')")
    }),
];

#[tokio::test(flavor = "multi_thread")]
async fn an_invalid_journal_is_reported_or_renamed_and_blocks_nothing() {
    let rig = Rig::quiet().await;
    rig.file("script.lua", "journal.add('before')");
    let mut run = rig.run_config(CONFIG);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let honest = std::fs::read(rig.folder().join("data/.journal/journal.db")).unwrap();
    for (what, tamper) in TAMPERINGS {
        let rig = Rig::quiet().await;
        let private = rig.file("private", SECRET);
        let folder = rig.folder().join("data/.journal");
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("journal.db");
        std::fs::write(&path, &honest).unwrap();
        tamper(&path, &private);
        // `spykee history` is the first to read it.
        rig.file("spykee.yaml", CONFIG);
        for topic in [&["all"][..], &["battery"], &["all", "--csv"]] {
            let args = [&["history", "--config", "spykee.yaml"], topic].concat();
            let mut history = rig.spykee(&args);
            history
                .code()
                .await
                .unwrap_or_else(|| panic!("{what}: `spykee history` was killed"));
            let text = history.text();
            assert!(
                !text.contains(SECRET) && !text.contains('\u{1b}') && !text.contains('\u{202e}'),
                "{what}: {text}"
            );
            assert!(!text.contains("panicked"), "{what}: {text}");
        }
        rig.file("script.lua", &format!("journal.add('here') {DRIVES}"));
        let args = ["run", "--config", "spykee.yaml", "--robot", &rig.address];
        let mut run = rig.spykee(&[&args[..], &["--live=127.0.0.1:0"]].concat());
        let from = rig.heard_motion(0).await;
        let (status, history) = get(&address(&run).await, "/api/history?days=365").await;
        assert!([200, 500].contains(&status), "{what}: {status}");
        assert!(!history.contains(SECRET), "{what}: {history}");
        drove_on(&rig, &mut run, from, what).await;
        assert_eq!(
            std::fs::read_to_string(&private).unwrap(),
            SECRET,
            "{what}: a private file was written"
        );
        assert!(!run.text().contains("panicked"), "{what}: {}", run.text());
    }
}
