//! The page and the API of a run from the browser's side, and the commands that the robot receives.

pub mod browser;

use std::os::unix::fs::PermissionsExt as _;
use std::time::Duration;

use proptest::prelude::*;
use rustix::process::Signal;
use serde_json::{Value, json};
use spykee::sim::{Firmware, FirmwareBehaviour};
use spykee::wire::{Command, Engage, Led, Stream};
use tokio::time::{sleep, timeout};

pub use self::browser::get;
use self::browser::{Page, Received, address, ask};
use crate::rig::{QUIET_WORLD, Rig, Run, Stopwatch, WAIT_LIMIT, assert_contains, moves};
use crate::terminal::Terminal;

const IDLE: &str = "task.wait(600)";
const DRIVE: &str = "while true do robot.move(30, 30, 0.5) end";
const LOOK: &str = "robot.on('frame', function(f) f:find_blobs('red') end)";

/// Starts a run with a page; returns it with the page's address.
pub async fn live(rig: &Rig, script: &str, more: &[&str]) -> (Run, String) {
    let path = rig.file("script.lua", script);
    let path = path.to_str().unwrap().to_owned();
    let args = [
        "run",
        &*path,
        "--robot",
        &*rig.address,
        "--live=127.0.0.1:0",
    ];
    let run = rig.spykee(&[&args[..], more].concat());
    let page = address(&run).await;
    run.says("connected").await;
    (run, page)
}

async fn open(address: &str) -> Page {
    let mut page = Page::open(address, "").await.unwrap();
    page.until("state", |state| state["link"] == "up").await;
    page
}

async fn post(address: &str, path: &str, headers: &str, body: Value) -> (u16, String) {
    ask(address, &format!("POST {path}"), headers, &body.to_string()).await
}

/// Takes control and drives until the robot moves; returns the index of that motion in the
/// journal.
async fn drive_by_hand(rig: &Rig, page: &mut Page) -> usize {
    let from = rig.sim.heard_count();
    page.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    page.until("state", |state| !state["driver"].is_null())
        .await;
    page.send_text("{\"type\":\"drive\",\"left\":40,\"right\":40}")
        .await;
    rig.heard_motion(from).await
}

/// Checks that nothing moves the robot from here on, for several times the lifetime of a setpoint.
async fn stays_still(rig: &Rig, from: usize) {
    sleep(Duration::from_millis(1200)).await;
    let moved = rig.commands(from).into_iter().find(moves);
    assert_eq!(moved, None, "it moves again");
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_from_other_sites_or_for_other_host_names_are_rejected() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let (status, body) = get(&at, "/api/status").await;
    assert_eq!(status, 200, "{body}");
    for headers in [
        "Host: evil.example\r\n",
        "Host: evil.example:80\r\n",
        "Host: a\r\nHost: b\r\n",
    ] {
        let (status, _) = ask(&at, "GET /api/status", headers, "").await;
        assert!(status == 421 || status == 400, "{headers}: {status}");
    }
    let evil = "Origin: http://evil.example\r\n";
    assert_eq!(post(&at, "/api/stop", evil, json!({})).await.0, 403);
    assert_eq!(Page::open(&at, evil).await.err(), Some(403));
    let cross = "Sec-Fetch-Site: cross-site\r\n";
    assert_eq!(post(&at, "/api/stop", cross, json!({})).await.0, 403);
    // Such a request, as an image in a page, would switch the camera on.
    for path in [
        "/api/picture",
        "/api/picture?seconds=1",
        "/api/camera.mjpeg",
    ] {
        let (status, _) = ask(&at, &format!("GET {path}"), cross, "").await;
        assert_eq!(status, 403, "{path}");
    }
    let video = |command: &Command| {
        matches!(
            command,
            Command::Stream {
                stream: Stream::Video,
                on: true
            }
        )
    };
    assert!(!rig.commands(0).iter().any(video));
    let (status, _) = ask(&at, "GET /api/status", cross, "").await;
    assert_eq!(status, 200, "a link from elsewhere only shows something");
    let own = format!("Origin: http://{at}\r\n");
    assert!(Page::open(&at, &own).await.is_ok());
    let (_, page) = get(&at, "/").await;
    assert!(
        page.contains("/app.js") && !page.contains("<style"),
        "{page}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_token_nothing_is_served_beyond_loopback() {
    let rig = Rig::quiet().await;
    rig.file("script.lua", IDLE);
    let args = [
        "run",
        "script.lua",
        "--robot",
        &rig.address,
        "--live=0.0.0.0:0",
    ];
    let mut run = rig.spykee(&args);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["spykee token new"]);
    assert!(!rig.commands(0).iter().any(moves));
}

/// Creates a token with this role.
pub async fn token(rig: &Rig, name: &str, role: &str) -> String {
    let mut made = rig.spykee(&["token", "new", name, "--role", role]);
    assert_eq!(made.code().await, Some(0), "{}", made.text());
    let text = made.text();
    text.lines()
        .find(|line| line.starts_with("spykee_"))
        .unwrap()
        .to_owned()
}

async fn revoke(rig: &Rig, name: &str) {
    let mut revoked = rig.spykee(&["token", "revoke", name]);
    assert_eq!(revoked.code().await, Some(0), "{}", revoked.text());
}

pub fn bearer(token: &str) -> String {
    format!("Authorization: Bearer {token}\r\n")
}

/// Asks until the answer has this status.
pub async fn until_status(at: &str, headers: &str, wanted: u16) {
    let reached = async {
        while ask(at, "GET /api/status", headers, "").await.0 != wanted {
            sleep(Duration::from_millis(50)).await;
        }
    };
    let reached = timeout(WAIT_LIMIT, reached).await;
    assert!(reached.is_ok(), "never {wanted}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_that_makes_room_for_a_driver_is_told_why() {
    let rig = Rig::quiet().await;
    let viewer = bearer(&token(&rig, "tv", "viewer").await);
    let driver = bearer(&token(&rig, "pad", "driver").await);
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut oldest = Page::open(&at, &viewer).await.unwrap();
    let mut others = Vec::new();
    for _ in 1..spykee::http::MAX_VIEWERS {
        others.push(Page::open(&at, &viewer).await.unwrap());
    }
    let _driver = Page::open(&at, &driver).await.unwrap();
    oldest
        .until("notice", |notice| notice["key"] == "evicted")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn each_token_has_the_rights_of_its_role() {
    let rig = Rig::quiet().await;
    let viewer = bearer(&token(&rig, "tv", "viewer").await);
    let driver = bearer(&token(&rig, "pad", "driver").await);
    let (_run, at) = live(&rig, IDLE, &[]).await;
    assert_eq!(get(&at, "/api/status").await.0, 401);
    assert_eq!(get(&at, "/metrics").await.0, 401);
    assert_eq!(get(&at, "/healthz").await.0, 200);
    assert_eq!(Page::open(&at, "").await.err(), Some(401));
    assert_eq!(ask(&at, "GET /api/status", &viewer, "").await.0, 200);
    let light = json!({ "light": "left", "on": true });
    assert_eq!(post(&at, "/api/led", &viewer, light.clone()).await.0, 403);
    let from = rig.sim.heard_count();
    assert_eq!(post(&at, "/api/led", &driver, light).await.0, 200);
    let on = Command::Led {
        led: Led::Left,
        on: true,
    };
    rig.heard(from, |command| *command == on).await;
    // Everyone who may look may stop.
    let from = rig.sim.heard_count();
    assert_eq!(post(&at, "/api/stop", &viewer, json!({})).await.0, 200);
    rig.heard_stop(from).await;
    assert_eq!(
        post(&at, "/api/reset-stop", &viewer, json!({})).await.0,
        403
    );
    let mut page = Page::open(&at, &viewer).await.unwrap();
    page.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    page.until("notice", |notice| notice["key"] == "viewer_only")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_login_exchanges_the_token_for_a_cookie_that_no_script_can_read() {
    let rig = Rig::quiet().await;
    let token = token(&rig, "phone", "driver").await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let (status, body) = post(&at, "/api/login", "", json!({ "token": "spykee_guess" })).await;
    assert_eq!(
        (status, body.contains("wrong token")),
        (401, true),
        "{body}"
    );
    let body = json!({ "token": token }).to_string();
    let request = format!(
        "POST /api/login HTTP/1.1\r\nHost: {at}\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let answer = browser::send(&at, request.as_bytes()).await;
    let answer = String::from_utf8_lossy(&answer).to_ascii_lowercase();
    let cookie = answer.lines().find(|line| line.starts_with("set-cookie: "));
    let cookie = cookie.unwrap().trim_start_matches("set-cookie: ");
    for part in ["; httponly", "; samesite=strict", "; path=/"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    assert!(answer.contains("\"role\":\"driver\""), "{answer}");
    let cookie = format!("Cookie: a=b; {}\r\n", cookie.split(';').next().unwrap());
    assert_eq!(ask(&at, "GET /api/status", &cookie, "").await.0, 200);
    revoke(&rig, "phone").await;
    until_status(&at, &cookie, 401).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn wrong_tokens_of_others_do_not_lock_out_a_valid_one() {
    let rig = Rig::quiet().await;
    let viewer = bearer(&token(&rig, "tv", "viewer").await);
    rig.file("spykee.yaml", "live: { hosts: [robot.example.org] }\n");
    let (run, at) = live(&rig, DRIVE, &["--config", "spykee.yaml"]).await;
    let wrong = bearer(&format!("spykee_{}", "0".repeat(64)));
    let from = rig.sim.heard_count();
    // Ten computers, each also behind a proxy on this one.
    for number in 0..140 {
        let source = format!("127.0.0.{}", 2 + number % 10);
        let proxied = format!("Host: robot.example.org\r\nX-Forwarded-For: {source}\r\n");
        for headers in [wrong.clone(), format!("{proxied}{wrong}")] {
            let line = "POST /api/stop";
            assert_eq!(
                browser::ask_from(&source, &at, line, &headers, "{}")
                    .await
                    .0,
                401
            );
            let login = "POST /api/login";
            let guess = "{\"token\":\"guess\"}";
            assert_eq!(
                browser::ask_from(&source, &at, login, &proxied, guess)
                    .await
                    .0,
                401
            );
        }
        for headers in [viewer.clone(), format!("{proxied}{viewer}")] {
            assert_eq!(ask(&at, "GET /api/status", &headers, "").await.0, 200);
            assert_eq!(post(&at, "/api/stop", &headers, json!({})).await.0, 200);
        }
    }
    rig.heard_stop(from).await;
    run.says("requests with a wrong token").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_hears_something_twice_a_second_while_nothing_changes() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut page = open(&at).await;
    let mut sent = Vec::new();
    while sent.len() < 6 {
        let heartbeat = page.until("heartbeat", |_| true).await;
        sent.push(heartbeat["milliseconds"].as_u64().unwrap());
    }
    // By the server's clock; a busy machine may delay one, but not each.
    let shortest = sent.windows(2).map(|two| two[1] - two[0]).min();
    assert!(shortest.is_some_and(|gap| gap <= 600), "{sent:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revoked_token_is_refused_within_a_second_and_without_any_the_page_stays_closed() {
    let rig = Rig::quiet().await;
    let pad = bearer(&token(&rig, "pad", "driver").await);
    let (mut run, at) = live(&rig, IDLE, &[]).await;
    let mut page = Page::open(&at, &pad).await.unwrap();
    page.until("state", |state| state["link"] == "up").await;
    revoke(&rig, "pad").await;
    page.closed().await;
    until_status(&at, &pad, 401).await;
    assert_eq!(get(&at, "/api/status").await.0, 401);
    let other = bearer(&token(&rig, "other", "viewer").await);
    until_status(&at, &other, 200).await;
    revoke(&rig, "other").await;
    until_status(&at, &other, 401).await;
    run.signal(Signal::INT);
    run.code().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    assert_eq!(get(&at, "/api/status").await.0, 401);
    assert_eq!(post(&at, "/api/stop", "", json!({})).await.0, 401);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_whose_tokens_cannot_be_read_is_not_served() {
    let rig = Rig::quiet().await;
    token(&rig, "pad", "driver").await;
    let file = rig.folder().join("spykee-data/.access/tokens.json");
    let readable = std::fs::Permissions::from_mode(0o644);
    std::fs::set_permissions(&file, readable).unwrap();
    rig.file("script.lua", DRIVE);
    let args = [
        "run",
        "script.lua",
        "--robot",
        &rig.address,
        "--live=127.0.0.1:0",
    ];
    let mut run = rig.spykee(&args);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert!(
        run.text().contains("cannot use the tokens"),
        "{}",
        run.text()
    );
    assert!(!rig.commands(0).iter().any(moves));
}

#[tokio::test(flavor = "multi_thread")]
async fn on_a_terminal_a_new_token_comes_with_a_link_and_its_qr_code() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "live: { listen: 192.168.1.7:7788 }\n");
    let args = ["token", "new", "phone", "--config", "spykee.yaml"];
    let mut terminal = Terminal::start(&args, &rig);
    terminal
        .shows("http://192.168.1.7:7788/#token=spykee_")
        .await;
    terminal.shows("\u{2580}").await;
    assert_eq!(terminal.code().await, Some(0), "{}", terminal.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_closed_page_stops_driving() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut page = open(&at).await;
    let moving = drive_by_hand(&rig, &mut page).await;
    drop(page);
    let stopped = rig.heard_stop(moving).await;
    stays_still(&rig, stopped).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_setpoint_that_is_not_renewed_expires_and_the_next_one_drives_again() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut page = open(&at).await;
    let watch = Stopwatch::start();
    let moving = drive_by_hand(&rig, &mut page).await;
    let stopped = rig.heard_stop(moving).await;
    let lived = (rig.at(stopped).0 - rig.at(moving).0).saturating_sub(watch.stalled());
    assert!(lived < Duration::from_secs(2), "{lived:?}");
    stays_still(&rig, stopped).await;
    for _ in 0..10 {
        page.send_text("{\"type\":\"drive\",\"left\":-30,\"right\":30}")
            .await;
        sleep(Duration::from_millis(50)).await;
    }
    let again = rig.heard_motion(stopped).await;
    page.send_text("{\"type\":\"drive_lock\",\"take\":false}")
        .await;
    rig.heard_stop(again).await;
    // Without the drive lock, a page moves nothing.
    let from = rig.sim.heard_count();
    page.send_text("{\"type\":\"drive\",\"left\":40,\"right\":40}")
        .await;
    stays_still(&rig, from).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_numbers_move_nothing() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut page = open(&at).await;
    page.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    page.until("state", |state| !state["driver"].is_null())
        .await;
    let from = rig.sim.heard_count();
    for wrong in ["1e999", "101", "-1e9", "\"40\"", "null"] {
        page.send_text(&format!(
            "{{\"type\":\"drive\",\"left\":{wrong},\"right\":40}}"
        ))
        .await;
    }
    stays_still(&rig, from).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_the_program_that_serves_the_page_hangs_or_is_killed() {
    for signal in [Signal::STOP, Signal::KILL] {
        let rig = Rig::quiet().await;
        let (run, at) = live(&rig, IDLE, &[]).await;
        let mut page = open(&at).await;
        let moving = drive_by_hand(&rig, &mut page).await;
        run.signal(signal);
        rig.heard_stop(moving).await;
        if signal == Signal::STOP {
            run.signal(Signal::CONT);
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn one_page_drives_and_the_others_see_who() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut anna = open(&at).await;
    let mut ben = open(&at).await;
    anna.send_text("{\"type\":\"name\",\"name\":\"Anna\"}")
        .await;
    drive_by_hand(&rig, &mut anna).await;
    ben.until("state", |state| state["driver"]["name"] == "Anna")
        .await;
    ben.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    let notice = ben
        .until("notice", |notice| notice["key"] == "drive_taken")
        .await;
    assert_eq!(notice["name"], "Anna");
    drop(anna);
    ben.until("state", |state| state["driver"].is_null()).await;
    drive_by_hand(&rig, &mut ben).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_docking_takes_the_drive_lock_and_taking_it_ends_the_docking() {
    let rig = Rig::near_home().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut page = open(&at).await;
    rig.sim.hide_station(true);
    drive_by_hand(&rig, &mut page).await;
    let from = rig.sim.heard_count();
    page.send_text("{\"type\":\"command\",\"id\":1,\"command\":{\"do\":\"dock\"}}")
        .await;
    let asked = rig.heard_dock(from).await;
    page.until("state", |state| state["driver"].is_null()).await;
    page.send_text("{\"type\":\"drive\",\"left\":40,\"right\":40}")
        .await;
    page.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    let answer = page.until("answer", |answer| answer["id"] == 1).await;
    assert_eq!(answer["text"], "cancelled");
    let cancelled = rig.heard_cancel(asked).await;
    assert!(!rig.commands_between(asked, cancelled).iter().any(moves));
    page.until("state", |state| !state["driver"].is_null())
        .await;
    page.send_text("{\"type\":\"drive\",\"left\":40,\"right\":40}")
        .await;
    rig.heard_motion(cancelled).await;
    rig.sim.hide_station(false);
    let home = page.until("state", |state| {
        state["driver"].is_null() && state["docked"] == true
    });
    let (docked, _) = tokio::join!(post(&at, "/api/dock", "", json!({})), home);
    assert_eq!(docked.0, 200);
}

#[tokio::test(flavor = "multi_thread")]
async fn stop_blocks_all_motion_until_it_is_released() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, DRIVE, &[]).await;
    let mut page = open(&at).await;
    rig.heard_motion(0).await;
    let from = rig.sim.heard_count();
    page.send_text("{\"type\":\"stop\"}").await;
    page.until("state", |state| state["emergency_stop"] == true)
        .await;
    let stopped = rig.heard_stop(from).await;
    stays_still(&rig, stopped).await;
    page.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    page.until("notice", |notice| notice["key"] == "drive_stopped")
        .await;
    // It also holds while no page is open.
    drop(page);
    let from = rig.sim.heard_count();
    stays_still(&rig, from).await;
    assert_eq!(post(&at, "/api/reset-stop", "", json!({})).await.0, 200);
    rig.heard_motion(from).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn stop_overrides_the_watchdog_that_sends_a_low_robot_home_even_at_the_end() {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let (mut run, at) = live(&rig, IDLE, &[]).await;
    rig.sim.set_battery(12.0);
    rig.heard_dock(0).await;
    assert_eq!(post(&at, "/api/stop", "", json!({})).await.0, 200);
    let cancel = |command: &Command| *command == Command::Engine(Engage::CancelDock);
    let stopped = rig.heard(0, cancel).await;
    let searches = |from| {
        let drives =
            |command: &Command| moves(command) || *command == Command::Engine(Engage::Dock);
        rig.commands(from).into_iter().find(drives)
    };
    sleep(Duration::from_secs(2)).await;
    assert_eq!(searches(stopped), None);
    rig.stands_still().await;
    assert_eq!(post(&at, "/api/reset-stop", "", json!({})).await.0, 200);
    let home = rig.heard_dock(stopped).await;
    assert_eq!(post(&at, "/api/stop", "", json!({})).await.0, 200);
    let stopped = rig.heard(home, cancel).await;
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(5), "{}", run.text());
    assert_eq!(searches(stopped), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_while_the_link_is_down_ends_the_search_at_the_next_login() {
    let firmware = Firmware {
        move_while_searching: FirmwareBehaviour::Ignored,
        search_limit: WAIT_LIMIT * 10,
        ..Firmware::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    rig.sim.hide_station(true);
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let mut page = open(&at).await;
    rig.sim.set_battery(12.0);
    let asked = rig.heard_dock(0).await;
    // A muted robot answers no login, and goes on searching.
    rig.sim.mute(true);
    rig.sim.disconnect_all();
    page.until("state", |state| state["link"] == "lost").await;
    assert_eq!(post(&at, "/api/stop", "", json!({})).await.0, 200);
    page.until("state", |state| state["emergency_stop"] == true)
        .await;
    assert!(rig.sim.state().searching);
    rig.sim.mute(false);
    rig.heard_cancel(asked).await;
    rig.stands_still().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn behaviours_are_ended_and_started_and_their_scripts_are_shown() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, DRIVE, &[]).await;
    let mut page = open(&at).await;
    let state = |wanted: &'static str| move |said: &Value| said["list"][0]["state"] == wanted;
    page.until("behaviours", state("running")).await;
    page.send_text("{\"type\":\"command\",\"id\":7,\"command\":{\"do\":\"behaviour\",\"name\":\"script\",\"change\":\"stop\"}}").await;
    let answer = page.until("answer", |answer| answer["id"] == 7).await;
    assert_eq!(answer["ok"], true, "{answer}");
    page.until("behaviours", state("idle")).await;
    // A page that opens now receives the same state, in whatever order the messages arrive.
    for _ in 0..10 {
        let mut page = open(&at).await;
        page.until("behaviours", state("idle")).await;
    }
    let from = rig.sim.heard_count();
    let body = json!({ "name": "script", "change": "start" });
    assert_eq!(post(&at, "/api/behaviour", "", body).await.0, 200);
    rig.heard_motion(from).await;
    let (status, text) = get(&at, "/api/behaviours/script/script").await;
    let text: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((status, text["text"].as_str()), (200, Some(DRIVE)));
    assert_eq!(
        get(&at, "/api/behaviours/..%2f..%2fetc/script").await.0,
        404
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_live_parameter_changes_within_its_bounds_while_the_script_drives() {
    let rig = Rig::quiet().await;
    let script =
        "local p = params.declare{ speed = {default = 30, min = 10, max = 60, live = true},
        mode = {default = 'calm'} } while true do robot.move(p.speed, p.speed, 0.2) end";
    let (_run, at) = live(&rig, script, &[]).await;
    let mut page = open(&at).await;
    page.until("behaviours", |said| {
        said["list"][0]["declared_params"][1]["value"] == 30.0
    })
    .await;
    let turn = |param: &'static str, value: Value| {
        let at = at.clone();
        async move {
            let body = json!({ "name": "script", "param": param, "value": value });
            post(&at, "/api/param", "", body).await
        }
    };
    for (param, value, words) in [
        ("speed", json!(61), "a number from 10 to 60"),
        ("speed", json!("fast"), "a number from 10 to 60"),
        ("mode", json!("wild"), "cannot be changed while"),
        ("sped", json!(20), "did you mean"),
    ] {
        let (status, body) = turn(param, value).await;
        assert!(status == 409 && body.contains(words), "{status} {body}");
    }
    let from = rig.sim.heard_count();
    assert_eq!(turn("speed", json!(55)).await.0, 200);
    let faster = |command: &Command| matches!(command, Command::Move { left, .. } if *left > 45);
    rig.heard(from, faster).await;
    page.until("behaviours", |said| {
        said["list"][0]["declared_params"][1]["value"] == 55.0
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_journal_and_timetable_the_run_says_so_and_no_path_leaves_the_picture_folder() {
    let rig = Rig::quiet().await;
    rig.file("secret.jpg", "not for everybody");
    let (_run, at) = live(&rig, IDLE, &[]).await;
    for path in [
        "/api/behaviours/script/pictures/1.jpg",
        "/api/behaviours/../pictures/secret.jpg",
        "/api/behaviours/..%2f/pictures/secret.jpg",
        "/api/behaviours/script/pictures/..%2f..%2fsecret.jpg",
    ] {
        let (status, body) = get(&at, path).await;
        assert_eq!(status, 404, "{path}: {body}");
        assert!(!body.contains("everybody"), "{path}: {body}");
    }
    for path in [
        "/api/history",
        "/api/history?days=7",
        "/api/pictures?since=0&until=1",
        "/api/schedule",
    ] {
        assert_eq!(get(&at, path).await, (200, "null".to_owned()), "{path}");
    }
    assert_eq!(get(&at, "/api/history?days=x").await.0, 400);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_history_of_a_year_is_thinned_to_its_lowest_and_highest_levels() {
    const YEAR: i64 = 365 * 24 * 60;
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "journal: { record: on }\n");
    let (_run, at) = live(&rig, IDLE, &["--config", "spykee.yaml"]).await;
    let path = spykee::journal::journal_file(&rig.folder().join("spykee-data"));
    // A level each minute, up and down between 20 and 99, and two dockings a day.
    let fill = format!(
        "BEGIN IMMEDIATE;
         WITH RECURSIVE minute(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM minute WHERE n < {YEAR})
         INSERT INTO battery SELECT unixepoch() * 1000 - n * 60000, 0, 'A', 20 + n % 80, n % 4 = 0 FROM minute;
         WITH RECURSIVE half(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM half WHERE n < 730)
         INSERT INTO event (at, session, robot, kind, data)
             SELECT unixepoch() * 1000 - n * 43200000 + 3600000, 0, 'A', 'dock',
                 CASE n % 10 WHEN 0 THEN '{{\"event\":\"dock\",\"end\":\"timeout\"}}'
                     WHEN 1 THEN 'damaged' ELSE '{{\"event\":\"dock\",\"end\":\"done\"}}' END FROM half;
         COMMIT;"
    );
    let filled = async {
        let existing = rusqlite::OpenFlags::SQLITE_OPEN_READ_WRITE;
        loop {
            let journal = rusqlite::Connection::open_with_flags(&path, existing);
            if journal.is_ok_and(|journal| journal.execute_batch(&fill).is_ok()) {
                return;
            }
            sleep(Duration::from_millis(100)).await;
        }
    };
    timeout(WAIT_LIMIT, filled)
        .await
        .expect("the program has made no tables");
    for days in ["365", "7", "1", "99", "60000"] {
        let (status, body) = get(&at, &format!("/api/history?days={days}")).await;
        assert!(
            status == 200 && body.len() < 64 * 1024,
            "{days}: {status}, {}",
            body.len()
        );
        let history: Value = serde_json::from_str(&body).unwrap();
        let parts = history["parts"].as_array().unwrap();
        assert!(
            (280..=288).contains(&parts.len()),
            "{days}: {}",
            parts.len()
        );
        let level = |part: &Value, key: &str| part[key].as_u64().unwrap_or(0);
        let inside = |part: &&Value| level(part, "low") >= 20 && level(part, "high") <= 99;
        assert!(
            parts.iter().filter(inside).count() >= 280,
            "{days}: {body:.300}"
        );
        assert!(history["events"].as_array().unwrap().len() <= 200);
    }
    let (_, body) = get(&at, "/api/history?days=365").await;
    let history: Value = serde_json::from_str(&body).unwrap();
    let parts = history["parts"].as_array().unwrap();
    let sum = |key: &str| {
        parts
            .iter()
            .filter_map(|part| part[key].as_u64())
            .sum::<u64>()
    };
    assert_eq!((sum("docks"), sum("failed_docks")), (584, 73));
    // Each part covers more than a day, so it has seen all levels.
    let whole = |part: &&Value| part["low"] == 20 && part["high"] == 99;
    assert!(parts.iter().filter(whole).count() >= 285, "{body:.300}");
    let share = parts[100]["charging"].as_f64().unwrap();
    assert!((share - 0.25).abs() < 0.01, "{share}");
    assert_eq!(get(&at, "/api/history?days=-1").await.0, 400);
}

#[tokio::test(flavor = "multi_thread")]
async fn frames_findings_and_log_reach_the_page() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, &format!("log.warn('<b>hostile</b>') {LOOK}"), &[]).await;
    let mut page = open(&at).await;
    page.send_text("{\"type\":\"watch\",\"camera\":true,\"found\":true,\"log\":true}")
        .await;
    let log = page
        .until("log", |log| log["lines"].to_string().contains("hostile"))
        .await;
    let lines = log["lines"].as_array().unwrap();
    let line = lines
        .iter()
        .find(|line| line["text"] == "<b>hostile</b>")
        .unwrap();
    assert_eq!(
        (line["behaviour"].as_str(), line["line"].as_u64()),
        (Some("script"), Some(1))
    );
    let mut frames = 0;
    let seen = async {
        while frames < 5 {
            if let Received::Frame(frame) = page.receive().await {
                spykee::vision::validate_markers(&frame[8..]).unwrap();
                page.send_text("{\"type\":\"frame_shown\"}").await;
                frames += 1;
            }
        }
    };
    timeout(WAIT_LIMIT, seen).await.expect("no frames");
    page.until("found", |found| found["behaviour"] == "script")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_number_of_viewers_is_limited_and_one_that_never_reads_is_disconnected() {
    let rig = Rig::quiet().await;
    let drive = "robot.move(30, 30) task.wait(600)";
    let (run, at) = live(&rig, drive, &[]).await;
    rig.heard_motion(0).await;
    let from = rig.sim.heard_count();
    let mut slow = Page::open(&at, "").await.unwrap();
    slow.send_text("{\"type\":\"watch\",\"camera\":true,\"log\":true}")
        .await;
    let mut good = open(&at).await;
    let mut others = Vec::new();
    for _ in 2..spykee::http::MAX_VIEWERS {
        others.push(open(&at).await);
    }
    assert_eq!(Page::open(&at, "").await.err(), Some(503));
    drop(others);
    good.send_text("{\"type\":\"watch\",\"camera\":true}").await;
    let mut frames = 0;
    let alone = async {
        loop {
            match good.receive().await {
                Received::Frame(_) => {
                    frames += 1;
                    good.send_text("{\"type\":\"frame_shown\"}").await;
                }
                Received::Text(state) if state["viewers"] == 1 => return,
                Received::Text(_) => {}
                Received::Closed => panic!("the good connection is closed"),
            }
        }
    };
    timeout(WAIT_LIMIT, alone)
        .await
        .expect("the slow viewer is not disconnected");
    assert!(frames > 20, "{frames}");
    rig.drives_on(&run, from).await;
    assert!(Page::open(&at, "").await.is_ok());
    drop(slow);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_book_is_served_where_it_is_built_and_no_path_leads_out_of_it() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_spykee"));
    let is_built = program
        .parent()
        .unwrap()
        .join("../book/index.html")
        .exists();
    let (status, page) = get(&at, "/book/").await;
    let expected = if is_built {
        (200, "<html")
    } else {
        (404, "scripts/book")
    };
    assert_eq!(status, expected.0, "{page}");
    assert!(page.contains(expected.1), "{page}");
    for path in [
        "/book/../api/status",
        "/book/%2e%2e/secret",
        "/book//etc/passwd",
    ] {
        let (status, _) = get(&at, path).await;
        assert_eq!(status, 404, "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn metrics_and_the_description_of_the_api_are_served() {
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, IDLE, &[]).await;
    let (status, metrics) = get(&at, "/metrics").await;
    assert_eq!(status, 200);
    for line in ["spykee_battery_percent 90", "spykee_link_up 1", "# EOF"] {
        assert!(metrics.contains(line), "{line}: {metrics}");
    }
    let (_, document) = get(&at, "/api/openapi.json").await;
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!(document["openapi"], "3.1.0");
    let (_, health) = get(&at, "/healthz").await;
    assert_eq!(health, "{\"live\":true,\"ready\":true}");
    let (status, jpeg) = get(&at, "/api/picture").await;
    assert!(status == 200 && jpeg.len() > 1000, "{status}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn no_bytes_on_the_websocket_harm_the_run(
        frames in prop::collection::vec((any::<u8>(), prop::collection::vec(any::<u8>(), 0..300)), 1..20)
    ) {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        runtime.block_on(async {
            let rig = Rig::quiet().await;
            let (mut run, at) = live(&rig, IDLE, &[]).await;
            let mut page = Page::open(&at, "").await.unwrap();
            for (head, payload) in &frames {
                page.frame(*head, payload).await;
            }
            drop(page);
            assert!(run.lives());
            assert_eq!(get(&at, "/healthz").await.0, 200);
            assert!(!rig.commands(0).iter().any(moves));
        });
    }
}
