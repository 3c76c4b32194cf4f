//! A class in the browser, with the real program: what a learner's robot does is seen on its map.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use rustix::process::{Pid, Signal};
use serde_json::{Value, json};
use tokio::time::{sleep, timeout};

use crate::live::browser::{Page, ask, send};
use crate::rig::{Run, WAIT_LIMIT, children_of, run_in, state_of};

const LESSON: &str = "03-moving";
const DRIVES: &str = "while true do robot.move(30, -30, 0.5) end";
const ATTACKS: &str = include_str!("../hostile/class.txt");

struct Class {
    folder: tempfile::TempDir,
    server: Run,
    address: String,
    word: String,
    teacher: String,
}

/// The words between two others in a text.
fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
    let (_, rest) = text
        .split_once(before)
        .unwrap_or_else(|| panic!("{before}: {text}"));
    rest.split(after).next().unwrap()
}

impl Class {
    async fn start() -> Class {
        Class::start_in(tempfile::tempdir().unwrap()).await
    }

    async fn start_in(folder: tempfile::TempDir) -> Class {
        let args = ["class", "8b", "--listen", "127.0.0.1:0"];
        let server = Run::start(&args, folder.path(), Stdio::null(), &[]);
        server.says("Ctrl-C ends the class").await;
        let text = server.text();
        Class {
            address: between(&text, "open at http://", "/").to_owned(),
            word: between(&text, "Class word: ", "\n").to_owned(),
            teacher: format!(
                "Cookie: spykee_token={}\r\n",
                between(&text, "#token=", "\n")
            ),
            folder,
            server,
        }
    }

    fn file(&self, learner: &str, name: &str) -> PathBuf {
        self.folder.path().join("8b").join(learner).join(name)
    }

    /// Asks to join; returns the header with the cookie.
    async fn join(&self, name: &str) -> String {
        let body = json!({ "word": self.word, "name": name }).to_string();
        let request = format!(
            "POST /class/join HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\n\
             Content-Length: {}\r\n\r\n{body}",
            self.address,
            body.len()
        );
        let answer = send(&self.address, request.as_bytes()).await;
        let answer = String::from_utf8(answer).unwrap();
        assert!(answer.contains("HttpOnly; SameSite=Strict"), "{answer}");
        format!("Cookie: {}\r\n", between(&answer, "set-cookie: ", ";"))
    }

    /// Joins and is let in.
    async fn learner(&self, name: &str) -> String {
        let cookie = self.join(name).await;
        let wall = self.state(&self.teacher).await;
        let waiting = wall["waiting"].as_array().unwrap();
        let device = waiting
            .iter()
            .rev()
            .find(|one| one["name"] == name)
            .unwrap();
        let decision = json!({ "id": device["id"], "admit": true });
        self.ok(&self.teacher, "POST /class/admit", decision).await;
        cookie
    }

    async fn ask(&self, who: &str, line: &str, body: Value) -> (u16, Value) {
        let (status, text) = ask(&self.address, line, who, &body.to_string()).await;
        (
            status,
            serde_json::from_str(&text).unwrap_or(Value::String(text)),
        )
    }

    async fn ok(&self, who: &str, line: &str, body: Value) -> Value {
        let (status, answer) = self.ask(who, line, body).await;
        assert_eq!(status, 200, "{line}: {answer}\n{}", self.server.text());
        answer
    }

    async fn state(&self, who: &str) -> Value {
        self.ok(who, "GET /class/me", Value::Null).await
    }

    async fn write(&self, who: &str, text: &str) {
        let old = self.ok(who, &script(), Value::Null).await;
        let new = json!({ "text": text, "version": old["version"] });
        let line = script().replace("GET", "PUT");
        self.ok(who, &line, new).await;
    }

    async fn run(&self, who: &str, text: &str) {
        self.write(who, text).await;
        self.ok(who, "POST /class/run", json!({ "lesson": LESSON }))
            .await;
    }

    /// The messages of a run's page, with the map.
    async fn robot(&self, who: &str, base: &str) -> Page {
        let mut page = Page::open_at(&self.address, &format!("{base}/live"), who)
            .await
            .unwrap();
        page.send_text("{\"type\":\"watch\",\"map\":true,\"camera\":true}")
            .await;
        page
    }

    /// Waits for a state of the caller's page.
    async fn until(&self, who: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let mut page = Page::open_at(&self.address, "/class/events", who)
            .await
            .unwrap();
        page.until("state", wanted).await
    }
}

fn script() -> String {
    format!("GET /class/script?lesson={LESSON}")
}

/// Waits until the robot has turned from where it is.
async fn turns(page: &mut Page) {
    let heading = |map: &Value| map["robot"][2].as_f64().unwrap();
    let first = heading(&page.until("map", |_| true).await);
    page.until("map", |map| (heading(map) - first).abs() > 0.2)
        .await;
}

/// Waits until these processes have ended.
async fn gone(processes: &[Pid]) {
    let ended = async {
        while processes
            .iter()
            .any(|pid| !matches!(state_of(*pid), '?' | 'X' | 'Z'))
        {
            sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, ended)
        .await
        .expect("a process lives on");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_learner_is_let_in_writes_drives_and_is_seen_on_the_wall() {
    let class = Class::start().await;
    let ada = class.join("Ada").await;
    assert_eq!(class.state(&ada).await["admitted"], false);
    assert_eq!(class.ask(&ada, &script(), Value::Null).await.0, 401);
    let ada = class.learner("Ada").await;
    let first = class.ok(&ada, &script(), Value::Null).await;
    assert!(first["text"].as_str().unwrap().contains("spykee lesson 3"));
    class.run(&ada, DRIVES).await;
    assert_eq!(
        std::fs::read_to_string(class.file("Ada", "03-moving.lua")).unwrap(),
        DRIVES
    );
    let mut page = class.robot(&ada, "/class").await;
    turns(&mut page).await;
    let wall = class.state(&class.teacher).await;
    assert_eq!(wall["learners"][0]["run"]["running"], true, "{wall}");
    class
        .robot(&class.teacher, "/class/of/Ada")
        .await
        .until("map", |_| true)
        .await;
    // The script ends, and the robot stays where it is.
    class.ok(&ada, "POST /class/stop", Value::Null).await;
    class
        .until(&ada, |state| state["run"]["running"] == false)
        .await;
    page.until("state", |state| state["tracks"] == json!([0, 0]))
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn freeze_makes_every_robot_stand_until_the_teacher_lets_them_go_on() {
    let class = Class::start().await;
    let ada = class.learner("Ada").await;
    class.run(&ada, DRIVES).await;
    let mut page = class.robot(&ada, "/class").await;
    turns(&mut page).await;
    class
        .ok(&class.teacher, "POST /class/freeze", json!({ "on": true }))
        .await;
    assert_eq!(class.state(&ada).await["frozen"], true);
    let order = json!({ "lesson": LESSON });
    assert_eq!(class.ask(&ada, "POST /class/run", order).await.0, 409);
    // The learner cannot let the clock go on.
    let resume = "{\"type\":\"command\",\"id\":1,\"command\":{\"do\":\"sim\",\"change\":{\"sim\":\"pause\",\"paused\":false}}}";
    page.send_text(resume).await;
    page.until("answer", |answer| answer["ok"] == true).await;
    let time = |map: &Value| map["time"].as_f64().unwrap();
    // The promise: everything stands after 0.3 s.
    sleep(Duration::from_millis(300)).await;
    let mut before = class.robot(&ada, "/class").await;
    let stands = time(&before.until("map", |_| true).await);
    sleep(Duration::from_millis(700)).await;
    let mut after = class.robot(&ada, "/class").await;
    assert_eq!(time(&after.until("map", |_| true).await), stands);
    class
        .ok(&class.teacher, "POST /class/freeze", json!({ "on": false }))
        .await;
    turns(&mut page).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_server_leaves_no_process_and_the_class_goes_on_where_it_stopped() {
    let mut class = Class::start().await;
    let ada = class.learner("Ada").await;
    class.run(&ada, DRIVES).await;
    turns(&mut class.robot(&ada, "/class").await).await;
    let runs = children_of(class.server.pid());
    assert!(!runs.is_empty());
    class.server.signal(Signal::KILL);
    class.server.status().await;
    gone(&runs).await;
    let again = Class::start_in(class.folder).await;
    let script = again.ok(&ada, &script(), Value::Null).await;
    assert_eq!(script["text"], DRIVES, "the same cookie, the same text");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_that_loops_hoards_or_floods_ends_alone() {
    let class = Class::start().await;
    let bo = class.learner("Bo").await;
    class.run(&bo, DRIVES).await;
    let mut robot = class.robot(&bo, "/class").await;
    for (name, text, says) in [
        ("Loop", "while true do end", "without waiting"),
        (
            "Memory",
            "local t = {} while true do t[#t + 1] = ('x'):rep(1e6) .. #t end",
            "memory",
        ),
        ("Module", "require('../Bo/03-moving')", "module"),
        ("Text", "this is not Luau", "03-moving.lua:1"),
    ] {
        let eve = class.learner(name).await;
        class.run(&eve, text).await;
        let ended = class
            .until(&eve, |state| !state["run"]["error"].is_null())
            .await;
        let error = ended["run"]["error"].as_str().unwrap();
        assert!(error.contains(says), "{name}: {error}");
        assert_eq!(ended["run"]["running"], false);
    }
    let flood = class.learner("Flood").await;
    class
        .run(
            &flood,
            "while true do print(('x'):rep(2000)) task.wait() end",
        )
        .await;
    turns(&mut robot).await;
    // Many runs of one learner are one run at a time, and soon refused.
    let mut refused = 0;
    for _ in 0..30 {
        let (status, _) = class
            .ask(&flood, "POST /class/run", json!({ "lesson": LESSON }))
            .await;
        refused += usize::from(status == 429);
    }
    assert!(refused > 0);
    let running = class.state(&class.teacher).await;
    let learners = running["learners"].as_array().unwrap();
    let open = learners
        .iter()
        .filter(|one| one["run"]["open"] == true)
        .count();
    assert!(children_of(class.server.pid()).len() <= open + 1, "{open}");
    turns(&mut robot).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_check_gives_points_that_stay_and_grade_finds_the_files() {
    let class = Class::start().await;
    let ada = class.learner("Ada").await;
    let check = json!({ "lesson": LESSON });
    let none = class.ok(&ada, "POST /class/check", check.clone()).await;
    assert_eq!(none["points"], 0);
    let solution = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/behaviours/lessons/03-moving/solution.lua"
    );
    class
        .write(&ada, &std::fs::read_to_string(solution).unwrap())
        .await;
    let full = class.ok(&ada, "POST /class/check", check).await;
    assert_eq!(full["points"], 10, "{full}");
    assert!(
        !full
            .to_string()
            .contains(class.folder.path().to_str().unwrap()),
        "{full}"
    );
    let wall = class.state(&class.teacher).await;
    assert_eq!(wall["learners"][0]["points"][LESSON], 10);
    let (_, csv) = class
        .ask(&class.teacher, "GET /class/points.csv", Value::Null)
        .await;
    assert!(csv.as_str().unwrap().contains("Ada,,,10"), "{csv}");
    let graded = run_in(
        class.folder.path(),
        &["lesson", "grade", "8b", "--lesson", "3", "--csv"],
    );
    assert!(graded.out.contains("\nAda,10,10,"), "{}", graded.text());
    let marks = json!({ "text": "local x = \nrobot.mvoe(1)", "lesson": LESSON });
    let marks = class.ok(&ada, "POST /class/marks", marks).await;
    assert_eq!(marks[0]["severity"], "error", "{marks}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_teachers_screen_can_be_seen_by_all_and_changed_by_none() {
    let class = Class::start().await;
    let ada = class.learner("Ada").await;
    class.run(&class.teacher, DRIVES).await;
    class
        .ok(&class.teacher, "POST /class/show", json!({ "on": true }))
        .await;
    let shown = script().replace("/class/", "/class/of/teacher/");
    assert_eq!(class.ok(&ada, &shown, Value::Null).await["text"], DRIVES);
    let mut page = class.robot(&ada, "/class/of/teacher").await;
    page.until("hello", |hello| hello["role"] == "viewer").await;
    turns(&mut page).await;
    page.send_text("{\"type\":\"command\",\"id\":1,\"command\":{\"do\":\"sim\",\"change\":{\"sim\":\"step\"}}}").await;
    page.until("answer", |answer| answer["ok"] == false).await;
    let put = shown.replace("GET", "PUT");
    assert_eq!(
        class
            .ask(&ada, &put, json!({ "text": "x", "version": "" }))
            .await
            .0,
        403
    );
    for what in ["run", "reset", "stop", "check"] {
        let line = format!("POST /class/of/teacher/{what}");
        assert_eq!(
            class.ask(&ada, &line, json!({ "lesson": LESSON })).await.0,
            403,
            "{what}"
        );
    }
    class
        .ok(&class.teacher, "POST /class/show", json!({ "on": false }))
        .await;
    assert_eq!(class.ask(&ada, &shown, Value::Null).await.0, 403);
}

/// The requests of `tests/hostile/class.txt`.
#[tokio::test(flavor = "multi_thread")]
async fn no_learner_reaches_anothers_things_or_the_teachers_rights() {
    let class = Class::start().await;
    let ada = class.learner("Ada").await;
    let bo = class.learner("Bo").await;
    let eve = class.join("Eve").await;
    class.write(&ada, "-- Ada").await;
    class.run(&bo, DRIVES).await;
    let mut robot = class.robot(&bo, "/class").await;
    let attacks = ATTACKS
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut count = 0;
    for attack in attacks {
        let parts: Vec<&str> = attack.split('|').map(str::trim).collect();
        let [who, line, headers, body, statuses] = parts[..] else {
            panic!("{attack}")
        };
        let cookie = match who {
            "Ada" => &ada,
            "Eve" => &eve,
            _ => "",
        };
        let mut all = cookie.to_owned();
        headers
            .split("; ")
            .filter(|one| one.contains(": "))
            .for_each(|one| all += &format!("{one}\r\n"));
        let body = body.replace("WORD", &class.word);
        let (status, answer) = ask(&class.address, line, &all, &body).await;
        let expected: Vec<&str> = statuses.split(' ').collect();
        assert!(
            expected.contains(&&*status.to_string()),
            "{attack}: {status} {answer}"
        );
        assert!(!answer.contains("robot.move"), "{attack}: {answer}");
        count += 1;
    }
    assert!(count >= 25);
    let theirs = std::fs::read_to_string(class.file("Bo", "03-moving.lua")).unwrap();
    assert_eq!(theirs, DRIVES);
    let wall = class.state(&class.teacher).await;
    assert_eq!(wall["frozen"], false);
    assert_eq!(wall["waiting"][0]["name"], "Eve");
    turns(&mut robot).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn huge_texts_links_idle_sockets_and_names_with_markup_do_no_harm() {
    let class = Class::start().await;
    let ada = class.learner("Ada").await;
    let put = script().replace("GET", "PUT");
    for length in [257 << 10, 600 << 10, 4 << 20] {
        let huge = json!({ "text": "x".repeat(length), "version": "" });
        let (status, _) = ask(&class.address, &put, &ada, &huge.to_string()).await;
        // A body that is not read to its end may cost the answer.
        assert!(status == 413 || status == 0, "{length}: {status}");
    }
    std::fs::write(class.folder.path().join("secret"), "secret").unwrap();
    std::fs::create_dir_all(class.file("Ada", "")).unwrap();
    std::os::unix::fs::symlink("../../secret", class.file("Ada", "03-moving.lua")).unwrap();
    let (status, answer) = class.ask(&ada, &script(), Value::Null).await;
    assert!(
        status == 500 && !answer.to_string().contains("\"secret\""),
        "{answer}"
    );
    let mut idle = Vec::new();
    for _ in 0..150 {
        let mut stream = tokio::net::TcpStream::connect(&class.address)
            .await
            .unwrap();
        let _ =
            tokio::io::AsyncWriteExt::write_all(&mut stream, b"POST /class/run HTTP/1.1\r\n").await;
        idle.push(stream);
    }
    let markup = class.learner("<img src=x>").await;
    class.write(&markup, "<script>alert(1)</script>").await;
    let wall = class.state(&class.teacher).await;
    assert_eq!(wall["learners"][0]["name"], "<img src=x>");
    let (_, csv) = class
        .ask(&class.teacher, "GET /class/points.csv", Value::Null)
        .await;
    assert!(!csv.as_str().unwrap().contains("\n="));
    let request = format!(
        "GET /class/script?lesson={LESSON} HTTP/1.1\r\nHost: {}\r\n{markup}\r\n",
        class.address
    );
    let answer = send(&class.address, request.as_bytes());
    let answer = String::from_utf8(answer.await).unwrap();
    assert!(
        answer.contains("application/json") && answer.contains("nosniff"),
        "{answer}"
    );
    assert!(Path::new(&class.file("<img src=x>", "03-moving.lua")).exists());
}
