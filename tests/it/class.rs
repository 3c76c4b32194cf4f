//! A class in the browser, with the real program: what a learner's robot does is seen on its map.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use rustix::process::{Pid, Signal};
use serde_json::{Value, json};
use tokio::time::{sleep, timeout};
use tokio_util::task::AbortOnDropHandle;

use crate::live::browser::{Page, Received, ask, send};
use crate::rig::{Rig, Run, WAIT_LIMIT, children_of, end_guardians, moves, run_in, state_of};

const LESSON: &str = "03-moving";
const DRIVES: &str = "while true do robot.move(30, -30, 0.5) end";
const ATTACKS: &str = include_str!("../hostile/class.txt");
const UPGRADE: &str = "Upgrade: websocket; Connection: Upgrade; \
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==; Sec-WebSocket-Version: 13";

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
        Class::start_with(folder, &[]).await
    }

    /// A class with this real robot.
    async fn with_robot(rig: &Rig) -> Class {
        let folder = tempfile::tempdir().unwrap();
        Class::start_with(folder, &["--robot", &rig.address]).await
    }

    async fn start_with(folder: tempfile::TempDir, more: &[&str]) -> Class {
        let args = [&["class", "8b", "--listen", "127.0.0.1:0"], more].concat();
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

    /// The page of somebody, who is there as long as it is open.
    async fn page(&self, who: &str) -> Page {
        let page = Page::open_at(&self.address, "/class/events", who).await;
        page.unwrap()
    }

    /// The page of somebody who is there until this is dropped.
    async fn here(&self, who: &str) -> AbortOnDropHandle<()> {
        let mut page = self.page(who).await;
        AbortOnDropHandle::new(tokio::spawn(async move {
            while !matches!(page.receive().await, Received::Closed) {}
        }))
    }

    /// A learner who is there and waits for a turn on the real robot.
    async fn waits(&self, name: &str) -> (String, AbortOnDropHandle<()>) {
        let who = self.learner(name).await;
        self.write(&who, DRIVES).await;
        let here = self.here(&who).await;
        self.ok(&who, "POST /class/turn", json!({ "on": true }))
            .await;
        (who, here)
    }

    /// A learner whose turn it is on the real robot.
    async fn driver(&self, name: &str) -> (String, AbortOnDropHandle<()>) {
        let (who, here) = self.waits(name).await;
        self.until(&who, has_turn).await;
        (who, here)
    }

    async fn drive(&self, who: &str) {
        let order = json!({ "lesson": LESSON });
        self.ok(who, "POST /class/turn/run", order).await;
    }

    async fn may_not_drive(&self, who: &str) {
        let order = json!({ "lesson": LESSON });
        let refused = self.ask(who, "POST /class/turn/run", order).await;
        assert_eq!(refused.0, 409, "{}", refused.1);
    }

    /// The teacher lets a robot go that has stood since it was stopped, and its driver goes on.
    async fn drives_when_let_go(&self, rig: &Rig, who: &str, stopped: usize) {
        rig.stands_still().await;
        assert!(!rig.commands(stopped).iter().any(moves));
        let stop = format!("robots/{}/stop", name_of(rig));
        self.switch(&stop, false).await;
        self.until(who, has_turn).await;
        self.drive(who).await;
        rig.heard_motion(stopped).await;
    }

    async fn end_turn(&self, who: &str) {
        self.ok(who, "POST /class/turn", json!({ "on": false }))
            .await;
    }

    /// The messages of a run's page, with the log.
    async fn log(&self, who: &str, base: &str) -> Page {
        let page = Page::open_at(&self.address, &format!("{base}/live"), who).await;
        let mut page = page.unwrap();
        page.send_text("{\"type\":\"watch\",\"log\":true}").await;
        page
    }

    /// What the teacher switches.
    async fn switch(&self, what: &str, on: bool) {
        let line = format!("POST /class/{what}");
        self.ok(&self.teacher, &line, json!({ "on": on })).await;
    }

    /// Waits for a state of the only robot on the wall.
    async fn robot_is(&self, states: &[&str]) {
        let is = |wall: &Value| {
            let state = wall["robots"]["robots"][0]["state"].as_str();
            states.contains(&state.unwrap())
        };
        self.until(&self.teacher, is).await;
    }

    /// Waits for a state of the caller's page.
    async fn until(&self, who: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let mut page = Page::open_at(&self.address, "/class/events", who)
            .await
            .unwrap();
        page.until("state", wanted).await
    }
}

impl Drop for Class {
    fn drop(&mut self) {
        // The guardians of agents that a test has killed.
        end_guardians(self.folder.path());
    }
}

fn has_turn(state: &Value) -> bool {
    !state["turns"]["turn"].is_null()
}

fn waits_first(state: &Value) -> bool {
    state["turns"]["place"] == 1
}

/// Whether the learner's script on the real robot has ended, and the robot stands.
fn stands(state: &Value) -> bool {
    state["turns"]["turn"]["runs"] == false
}

/// The name of the robot, as the class calls it.
fn name_of(rig: &Rig) -> String {
    rig.address.replace(':', "-")
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
    let folder = std::mem::replace(&mut class.folder, tempfile::tempdir().unwrap());
    let again = Class::start_in(folder).await;
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
async fn a_run_of_blocks_tells_which_line_runs() {
    let class = Class::start().await;
    let ada = class.learner("Ada").await;
    let text = "local easy = require(\"@spykee/easy\")\n\nwhile true do\n\teasy.left(10)\n\n\
                \tif true then\n\t\teasy.wait(0.1)\n\tend\nend\n";
    class.write(&ada, text).await;
    let order = json!({ "lesson": LESSON, "blocks": true });
    class.ok(&ada, "POST /class/run", order).await;
    let mut page = class.log(&ada, "/class").await;
    for line in ["4", "7", "4"] {
        let is_it = |one: &Value| one["text"] == line && one["behaviour"] == LESSON;
        let runs = |log: &Value| log["lines"].as_array().unwrap().iter().any(is_it);
        page.until("log", runs).await;
    }
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
    for what in ["run", "stop", "check"] {
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
    page.closed().await;
}

/// The requests of `tests/hostile/class.txt`.
#[tokio::test(flavor = "multi_thread")]
async fn no_learner_reaches_anothers_things_or_the_teachers_rights() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let ada = class.learner("Ada").await;
    let (bo, _here) = class.driver("Bo").await;
    class.drive(&bo).await;
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
            "teacher" => &class.teacher,
            _ => "",
        };
        let line = line.replace("ROBOT", &name_of(&rig));
        let line = line.as_str();
        let mut all = cookie.to_owned();
        let headers = headers.replace("UPGRADE", UPGRADE);
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
    let robots = &wall["robots"];
    assert_eq!(robots["robots"][0]["driver"], "Bo", "{robots}");
    assert_eq!(robots["minutes"], 3, "{robots}");
    turns(&mut robot).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_turn_drives_the_real_robot_and_ends_with_its_stop_before_the_next_begins() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let (ada, _here) = class.driver("Ada").await;
    let (bo, here) = class.waits("Bo").await;
    class.until(&bo, waits_first).await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(0).await;
    let mut robot = class.robot(&ada, "/class/turn").await;
    robot
        .until("hello", |hello| hello["role"] == "viewer")
        .await;
    robot.send_text("{\"type\":\"reset_stop\"}").await;
    robot
        .until("notice", |notice| notice["key"] == "viewer_only")
        .await;
    // The learner ends the turn early: the robot stands, and what was seen of it is closed.
    class.end_turn(&ada).await;
    let stopped = rig.heard_stop(moving).await;
    robot.closed().await;
    class.until(&bo, has_turn).await;
    class.drive(&bo).await;
    let moving = rig.heard_motion(stopped).await;
    class.ok(&bo, "POST /class/turn/stop", Value::Null).await;
    let stopped = rig.heard_stop(moving).await;
    class.until(&bo, stands).await;
    class.write(&bo, "error('of Bo')").await;
    class.drive(&bo).await;
    let failed = |state: &Value| {
        state["turns"]["turn"]["error"]
            .to_string()
            .contains("of Bo")
    };
    class.until(&bo, failed).await;
    class.write(&bo, DRIVES).await;
    class.drive(&bo).await;
    let moving = rig.heard_motion(stopped).await;
    drop(here);
    rig.heard_stop(moving).await;
    rig.stands_still().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn freeze_and_the_teachers_stop_beat_whoever_drives_until_the_teacher_lets_go() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let (ada, _here) = class.driver("Ada").await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(0).await;
    class.switch("freeze", true).await;
    let stopped = rig.heard_stop(moving).await;
    class.may_not_drive(&ada).await;
    class.until(&ada, stands).await;
    class.switch("freeze", false).await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(stopped).await;
    let stop = format!("robots/{}/stop", name_of(&rig));
    class.switch(&stop, true).await;
    let stopped = rig.heard_stop(moving).await;
    class.robot_is(&["stopped"]).await;
    class.may_not_drive(&ada).await;
    // The rest of the turn is given back, and comes first.
    class.until(&ada, waits_first).await;
    class.drives_when_let_go(&rig, &ada, stopped).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stands_when_its_agent_or_the_server_is_killed() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let (ada, _here) = class.driver("Ada").await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(0).await;
    let agents = children_of(class.server.pid());
    assert_eq!(agents.len(), 1);
    rustix::process::kill_process(agents[0], Signal::KILL).unwrap();
    let stopped = rig.heard_stop(moving).await;
    // Another agent takes its place.
    class
        .until(&ada, |state| state["turns"]["turn"]["number"] == 2)
        .await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(stopped).await;
    let agents = children_of(class.server.pid());
    class.server.signal(Signal::KILL);
    rig.heard_stop(moving).await;
    rig.stands_still().await;
    gone(&agents).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_low_robot_goes_home_whoever_drives_and_comes_back_when_it_is_charged() {
    let rig = Rig::near_home().await;
    let class = Class::with_robot(&rig).await;
    let (ada, _here) = class.driver("Ada").await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(0).await;
    rig.sim.set_battery(15.0);
    let docks = rig.heard_dock(moving).await;
    class.robot_is(&["going_home", "charging"]).await;
    class.until(&ada, waits_first).await;
    class.robot_is(&["charging"]).await;
    rig.sim.set_battery(59.0);
    let level = |wall: &Value| wall["robots"]["robots"][0]["percent"].as_u64() >= Some(59);
    class.until(&class.teacher, level).await;
    assert!(!rig.commands(docks).iter().any(moves));
    rig.sim.set_battery(90.0);
    class.until(&ada, has_turn).await;
    // It leaves its station by itself.
    class.drive(&ada).await;
    rig.heard_motion(docks).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_driver_sees_nothing_of_the_turn_before() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let (ada, _ada_here) = class.driver("Ada").await;
    let (bo, _bo_here) = class.waits("Bo").await;
    class.write(&ada, "print('of Ada') error('of Ada')").await;
    class.drive(&ada).await;
    let failed = |state: &Value| {
        let error = &state["turns"]["turn"]["error"];
        error.to_string().contains("of Ada")
    };
    class.until(&ada, failed).await;
    let is_hers = |log: &Value| log.to_string().contains("of Ada");
    let mut page = class.log(&ada, "/class/turn").await;
    page.until("log", is_hers).await;
    class.end_turn(&ada).await;
    class.until(&bo, has_turn).await;
    let mut page = class.log(&bo, "/class/turn").await;
    let first = page.until("log", |_| true).await;
    assert!(!is_hers(&first), "{first}");
    let list = page.until("behaviours", |_| true).await;
    assert!(!is_hers(&list), "{list}");
    // What the agent tells next is not about that script either.
    rig.sim.set_battery(80.0);
    let level = |wall: &Value| wall["robots"]["robots"][0]["percent"] == 80;
    class.until(&class.teacher, level).await;
    let state = class.state(&bo).await;
    assert_eq!(state["turns"]["turn"]["error"], Value::Null, "{state}");
    class.write(&bo, "print('of Bo')").await;
    class.drive(&bo).await;
    page.until("log", |log| log.to_string().contains("of Bo"))
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_while_the_agent_restarts_holds_as_soon_as_it_is_back() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let (ada, _here) = class.driver("Ada").await;
    class.drive(&ada).await;
    let moving = rig.heard_motion(0).await;
    let agents = children_of(class.server.pid());
    rustix::process::kill_process(agents[0], Signal::KILL).unwrap();
    class.robot_is(&["disconnected"]).await;
    let stop = format!("robots/{}/stop", name_of(&rig));
    class.switch(&stop, true).await;
    let wall = class.state(&class.teacher).await;
    let robot = &wall["robots"]["robots"][0];
    let waits = robot["state"] == "stop_waits" && robot["stopped"] == true;
    assert!(waits, "{robot}");
    class.robot_is(&["stopped"]).await;
    let stopped = rig.heard_stop(moving).await;
    class.may_not_drive(&ada).await;
    class.drives_when_let_go(&rig, &ada, stopped).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_of_a_page_that_has_fallen_silent_stands() {
    let rig = Rig::quiet().await;
    let class = Class::with_robot(&rig).await;
    let (ada, here) = class.driver("Ada").await;
    // Answers no ping, as one whose tablet has left the network.
    let _silent = class.page(&ada).await;
    drop(here);
    class.drive(&ada).await;
    rig.heard_motion(0).await;
    class.robot_is(&["turn"]).await;
    rig.stands_still().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn simulated_robots_take_the_place_of_real_ones() {
    let folder = tempfile::tempdir().unwrap();
    let class = Class::start_with(folder, &["--sim", "2"]).await;
    let (ada, _here) = class.driver("Ada").await;
    class.drive(&ada).await;
    let mut robot = class.robot(&ada, "/class/turn").await;
    let moves = |state: &Value| state["tracks"] == json!([30, -30]);
    robot.until("state", moves).await;
    class.ok(&ada, "POST /class/turn/stop", Value::Null).await;
    class.until(&ada, stands).await;
    let wall = class.state(&class.teacher).await;
    assert_eq!(wall["robots"]["robots"].as_array().unwrap().len(), 2);
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
