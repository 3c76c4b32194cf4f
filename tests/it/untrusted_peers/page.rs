//! Clients of the page that are slow, greedy, many or send garbage.

use std::time::Duration;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use spykee::sim::{Options, World};
use spykee::wire::Command;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout};
use tokio_util::task::AbortOnDropHandle;

use super::{DRIVES, drove_on};
use crate::live::browser::{self, Page, address, ask, get};
use crate::live::{bearer, token, until_status};
use crate::rig::{QUIET_WORLD, Rig, Run, WAIT_LIMIT};

/// How long a STOP may take until the robot hears it, whatever others do.
const STOP_LIMIT: Duration = Duration::from_secs(2);

/// Starts a run that drives; returns it with the address of its page.
async fn driving(rig: &Rig) -> (Run, String) {
    rig.file("script.lua", DRIVES);
    let run = rig.spykee(&[
        "run",
        "script.lua",
        "--robot",
        &rig.address,
        "--live=127.0.0.1:0",
    ]);
    let at = address(&run).await;
    rig.heard_motion(0).await;
    (run, at)
}

/// The status of an answer; 0 if the connection was closed without one.
fn status(answer: &[u8]) -> u16 {
    let text = String::from_utf8_lossy(answer);
    text.split(' ')
        .nth(1)
        .and_then(|code| code.parse().ok())
        .unwrap_or(0)
}

/// Connections that have sent this and then send nothing more.
async fn stuck(at: &str, count: usize, said: &str) -> Vec<TcpStream> {
    let mut all = Vec::new();
    for _ in 0..count {
        let mut one = TcpStream::connect(at).await.unwrap();
        one.write_all(said.as_bytes()).await.unwrap();
        all.push(one);
    }
    all
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_that_never_end_do_not_block_other_clients() {
    let rig = Rig::quiet().await;
    let (mut run, at) = driving(&rig).await;
    let from = rig.sim.heard_count();
    // More than the server handles at the same time.
    const MANY: usize = 100;
    let login =
        format!("POST /api/login HTTP/1.1\r\nHost: {at}\r\nContent-Type: application/json\r\n");
    for said in [
        String::new(),
        "GET".to_owned(),
        format!("GET /healthz HTTP/1.1\r\nHost: {at}\r\nX: "),
        format!("{login}Content-Length: 1000\r\n\r\n{{"),
        format!("{login}Transfer-Encoding: chunked\r\n\r\n4\r\n{{\"pa\r\n"),
        format!("POST /api/say HTTP/1.1\r\nHost: {at}\r\nContent-Length: 900000\r\n\r\n12"),
    ] {
        let held = stuck(&at, MANY, &said).await;
        assert_eq!(get(&at, "/healthz").await.0, 200, "{said:?}");
        drop(held);
    }
    drove_on(&rig, &mut run, from, "slow requests").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_that_arrives_byte_by_byte_times_out() {
    let rig = Rig::quiet().await;
    let (mut run, at) = driving(&rig).await;
    let from = rig.sim.heard_count();
    let mut slow = TcpStream::connect(&at).await.unwrap();
    let head = format!(
        "POST /api/led HTTP/1.1\r\nHost: {at}\r\nContent-Type: application/json\r\nContent-Length: 9000\r\n\r\n{{"
    );
    slow.write_all(head.as_bytes()).await.unwrap();
    let given_up = async {
        let (mut reader, mut writer) = slow.split();
        let mut answer = Vec::new();
        let drip = async {
            while writer.write_all(b" ").await.is_ok() {
                tokio::time::sleep(Duration::from_millis(200)).await;
            }
            std::future::pending::<()>().await;
        };
        tokio::select! {
            _ = reader.read_to_end(&mut answer) => answer,
            () = drip => Vec::new(),
        }
    };
    let answer = timeout(WAIT_LIMIT, given_up)
        .await
        .expect("the server waits for it forever");
    assert!(
        [0, 400, 408].contains(&status(&answer)),
        "{}",
        String::from_utf8_lossy(&answer)
    );
    drove_on(&rig, &mut run, from, "a slow body").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn endless_long_or_malformed_bodies_are_refused() {
    let rig = Rig::quiet().await;
    let (mut run, at) = driving(&rig).await;
    let from = rig.sim.heard_count();
    let deep = "[".repeat(8000);
    let wide = format!(
        "{{\"light\":\"left\",\"on\":true{}}}",
        ",\"on\":true".repeat(1000)
    );
    let bodies = [
        "",
        "{",
        "[]",
        "null",
        "0",
        "\"left\"",
        "{}",
        "{\"light\":\"left\"}",
        "\u{0}",
        "\u{feff}{}",
        "{\"light\":\"left\",\"on\":1}",
        "{\"light\":\"LEFT\",\"on\":true}",
        "{\"light\":\"left\",\"on\":true,\"more\":1}",
        "{\"light\":\"left\",\"on\":true} {}",
        "<led on=\"true\"/>",
        "light=left&on=true",
        &*deep,
        &*wide,
    ];
    for body in bodies {
        let (status, answer) = ask(&at, "POST /api/led", "", body).await;
        assert!(
            (400..500).contains(&status),
            "{body:.60}: {status} {answer}"
        );
    }
    for (path, body) in [
        ("/api/play", "{\"sound\":\"<script>alert(1)</script>\"}"),
        ("/api/volume", "{\"percent\":101}"),
        ("/api/volume", "{\"percent\":1e99}"),
        (
            "/api/behaviour",
            "{\"name\":\"../etc\",\"change\":\"start\"}",
        ),
        ("/api/behaviour", "{\"name\":\"<b>\",\"change\":\"start\"}"),
        ("/api/behaviour", "{\"name\":\"nobody\",\"change\":\"fly\"}"),
        (
            "/api/behaviour",
            "{\"name\":\"nobody\",\"change\":\"start\"}",
        ),
        ("/api/dance", "{}"),
        ("/api/status", "{}"),
        ("/api/login", "{\"token\":\"guess\"}"),
        ("/api/login", "{\"password\":\"guess\"}"),
    ] {
        let (status, answer) = ask(&at, &format!("POST {path}"), "", body).await;
        assert!((400..500).contains(&status), "{path}: {status} {answer}");
    }
    // Half a minute, and one byte more.
    let speech = "x".repeat(30 * 32_000 + 1);
    let refused = ask(&at, "POST /api/say", "", &speech).await;
    assert!(
        refused.0 == 413 && refused.1.contains("too long to say at once"),
        "{refused:?}"
    );
    let led = format!("POST /api/led HTTP/1.1\r\nHost: {at}\r\nContent-Type: application/json\r\n");
    for framing in [
        "Content-Length: 99999999999\r\n\r\n",
        "Content-Length: -1\r\n\r\n",
        "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    ] {
        let answer = browser::send(&at, format!("{led}{framing}").as_bytes()).await;
        let is_refused = (400..500).contains(&status(&answer));
        assert!(
            is_refused,
            "{framing}: {}",
            String::from_utf8_lossy(&answer)
        );
    }
    let mut endless = TcpStream::connect(&at).await.unwrap();
    let (mut reader, mut writer) = endless.split();
    writer
        .write_all(format!("{led}Transfer-Encoding: chunked\r\n\r\n").as_bytes())
        .await
        .unwrap();
    let chunk = format!("400\r\n{}\r\n", "x".repeat(0x400));
    let pour = async { while writer.write_all(chunk.as_bytes()).await.is_ok() {} };
    let mut answer = Vec::new();
    let refused = async { tokio::join!(pour, reader.read_to_end(&mut answer)) };
    timeout(WAIT_LIMIT, refused)
        .await
        .expect("the server reads an endless body forever")
        .1
        .ok();
    assert!(
        [0, 413].contains(&status(&answer)),
        "{}",
        String::from_utf8_lossy(&answer)
    );
    drove_on(&rig, &mut run, from, "bodies").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn malformed_requests_and_foreign_paths_reach_neither_a_file_nor_the_robot() {
    let rig = Rig::quiet().await;
    let (mut run, at) = driving(&rig).await;
    let from = rig.sim.heard_count();
    for path in [
        "/../../../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/etc/passwd%00.js",
        "/app.js/../../../etc/passwd",
        "/api/behaviours/..%2f..%2f..%2fetc%2fpasswd/script",
        "/api/behaviours/%00/script",
        "/api/behaviours/%ff%fe/script",
        "/spykee.yaml",
        "/script.lua",
        "/%0d%0aSet-Cookie:%20a=b",
        "/?<script>alert(1)</script>",
        "/api/status?callback=alert",
        "/api/../api/stop",
        "http://127.0.0.1:22/",
        "*",
    ] {
        let answer = browser::send(
            &at,
            format!("GET {path} HTTP/1.1\r\nHost: {at}\r\n\r\n").as_bytes(),
        )
        .await;
        let text = String::from_utf8_lossy(&answer);
        assert!(
            !text.contains("root:") && !text.contains(DRIVES),
            "{path}: {text}"
        );
        assert!(
            !text.contains("<script>alert") && !text.contains("Set-Cookie"),
            "{path}: {text}"
        );
    }
    for method in [
        "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "STOP", "post", "\u{1}",
    ] {
        let answer = browser::send(
            &at,
            format!("{method} /api/stop HTTP/1.1\r\nHost: {at}\r\n\r\n").as_bytes(),
        )
        .await;
        assert!(
            !(200..300).contains(&status(&answer)),
            "{method}: {}",
            String::from_utf8_lossy(&answer)
        );
    }
    for bytes in [
        &b"\0\0\0\0"[..],
        b"GET / HTTP/1.1\r\n",
        b"POST /api/stop HTTP/9.9\r\n\r\n",
    ] {
        browser::send(&at, bytes).await;
    }
    let many: String = (0..1000)
        .map(|number| format!("x-{number}: y\r\n"))
        .collect();
    let long = format!("x: {}\r\n", "y".repeat(1 << 20));
    let hello = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".to_vec();
    for head in [
        format!("GET / HTTP/1.1\r\nHost: {at}\r\n{many}\r\n").into_bytes(),
        format!("GET / HTTP/1.1\r\nHost: {at}\r\n{long}\r\n").into_bytes(),
        format!(
            "GET /{} HTTP/1.1\r\nHost: {at}\r\n\r\n",
            "a".repeat(1 << 20)
        )
        .into_bytes(),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec(),
        format!("GET / HTTP/1.1\r\nHost: {at}\r\n folded: yes\r\n\r\n").into_bytes(),
        format!("GET / HTTP/1.1\nHost: {at}\n\n\n").into_bytes(),
        format!("GET / HTTP/1.1\r\nHost: {at}\r\nHost: {at}\r\n\r\n").into_bytes(),
        hello,
        vec![0xff; 100_000],
    ] {
        let mut stream = TcpStream::connect(&at).await.unwrap();
        let (mut reader, mut writer) = stream.split();
        let mut answer = Vec::new();
        let both = async { tokio::join!(writer.write_all(&head), reader.read_to_end(&mut answer)) };
        let _ = timeout(WAIT_LIMIT, both)
            .await
            .expect("neither an answer nor an end of the connection");
        assert!(!String::from_utf8_lossy(&answer).contains("root:"));
    }
    assert_eq!(get(&at, "/healthz").await.0, 200);
    drove_on(&rig, &mut run, from, "heads").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn endless_or_invalid_messages_end_only_their_own_connection() {
    let rig = Rig::quiet().await;
    let (mut run, at) = driving(&rig).await;
    let from = rig.sim.heard_count();
    let mut good = Page::open(&at, "").await.unwrap();
    let piece = vec![b'x'; 1000];
    // A text message that never ends, one fragment at a time.
    let mut endless = Page::open(&at, "").await.unwrap();
    endless.frame(0x01, &piece).await;
    for _ in 0..40 {
        endless.frame(0x00, &piece).await;
    }
    endless.closed().await;
    for (head, payload) in [
        (0x80, &b"goes on, and nothing began"[..]),
        (0x83, &b"reserved"[..]),
        (0x8b, &b"reserved control"[..]),
        (0xc1, &b"a bit that means nothing"[..]),
        (0x09, &b"a ping in pieces"[..]),
        (0x89, &[7; 126][..]),
        (0x88, &b"\x03"[..]),
        (0x88, &[0xff; 100][..]),
        (0x82, &b"{\"type\":\"stop\"}"[..]),
        (0xf1, &b"{}"[..]),
        (0x81, &[0xff; 10][..]),
        (0x81, &[b'x'; 100_000][..]),
    ] {
        let mut bad = Page::open(&at, "").await.unwrap();
        bad.frame(head, payload).await;
        bad.closed().await;
    }
    for raw in [
        &[
            0x81, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0,
        ][..],
        &[
            0x81, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0,
        ],
        // Without a mask, which no browser does.
        b"\x81\x0f{\"type\":\"stop\"}",
    ] {
        let mut bad = Page::open(&at, "").await.unwrap();
        bad.raw(raw).await;
        bad.closed().await;
    }
    let mut pings = Page::open(&at, "").await.unwrap();
    for _ in 0..2000 {
        pings.frame(0x89, &b"x"[..]).await;
    }
    pings.closed().await;
    let mut flood = Page::open(&at, "").await.unwrap();
    for _ in 0..1000 {
        flood.send_text("{\"type\":\"frame_shown\"}").await;
    }
    flood.closed().await;
    let mut odd = Page::open(&at, "").await.unwrap();
    let deep = format!("{{\"type\":{}", "[".repeat(10_000));
    for said in [
        &*deep,
        "null",
        "[]",
        "{\"type\":\"drive\"}",
        "{\"type\":\"drive\",\"left\":1e999,\"right\":0}",
        "{\"type\":\"command\",\"id\":-1,\"command\":{\"do\":\"dock\"}}",
        "{\"type\":\"stop\",\"type\":\"stop\"}",
        "{\"type\":\"watch\",\"camera\":\"yes\"}",
    ] {
        odd.send_text(said).await;
        odd.until("notice", |notice| notice["key"] == "nonsense")
            .await;
    }
    // A command that has a number gets an answer to it.
    for order in [
        "{\"do\":\"sim\",\"change\":{\"sim\":\"fly\"}}",
        "{\"do\":\"volume\",\"percent\":101}",
    ] {
        odd.send_text(&format!(
            "{{\"type\":\"command\",\"id\":7,\"order\":{order}}}"
        ))
        .await;
        let answer = odd.until("answer", |answer| answer["id"] == 7).await;
        assert!(answer["ok"] == false && answer["text"] != "", "{answer}");
    }
    // No page has the drive lock, so none can drive.
    odd.send_text("{\"type\":\"drive\",\"left\":-90,\"right\":-90}")
        .await;
    good.until("state", |state| state["tracks"][0] == 30).await;
    assert!(!rig.commands(from).contains(&Command::Move {
        left: -81,
        right: -81
    }));
    drove_on(&rig, &mut run, from, "messages").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn with_a_thousand_connections_an_open_page_can_still_stop_the_robot() {
    let most = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: most.maximum,
        ..most
    };
    setrlimit(Resource::Nofile, raised).unwrap();
    let rig = Rig::quiet().await;
    let (mut run, at) = driving(&rig).await;
    let from = rig.sim.heard_count();
    let mut page = Page::open(&at, "").await.unwrap();
    let door = at.clone();
    let crowd = tokio::spawn(async move { stuck(&door, 1000, "GET / HTTP/1.1\r\n").await });
    // Sends signs of life meanwhile, as pages do.
    while !crowd.is_finished() {
        page.receive().await;
    }
    let held = crowd.await.unwrap();
    page.send_text("{\"type\":\"stop\"}").await;
    rig.heard_stop(from).await;
    drop(held);
    assert_eq!(get(&at, "/healthz").await.0, 200);
    run.signal(rustix::process::Signal::TERM);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
}

/// Presses STOP through the API; the robot must hear it in time. Then lets it drive again.
async fn stops_in_time(rig: &Rig, at: &str, headers: &str, what: &str) {
    let from = rig.sim.heard_count();
    let began = Instant::now();
    let stopped = async {
        let (status, body) = ask(at, "POST /api/stop", headers, "{}").await;
        assert_eq!(status, 200, "{what}: {body}");
        rig.heard_stop(from).await;
    };
    let stopped = timeout(WAIT_LIMIT, stopped).await;
    let took = began.elapsed();
    println!("{what}: STOP took {took:?}");
    assert!(stopped.is_ok() && took < STOP_LIMIT, "{what}: {took:?}");
    let from = rig.sim.heard_count();
    assert_eq!(ask(at, "POST /api/reset-stop", headers, "{}").await.0, 200);
    rig.heard_motion(from).await;
}

/// A client that opens connections, keeps them open, and sends a byte a second on each.
fn dripping(at: &str, count: usize, said: &str) -> AbortOnDropHandle<()> {
    let said = said.to_owned();
    let at = at.to_owned();
    AbortOnDropHandle::new(tokio::spawn(async move {
        let mut held = stuck(&at, count, &said).await;
        loop {
            sleep(Duration::from_secs(1)).await;
            for one in &mut held {
                // Those that the server has closed are opened again.
                if one.write_all(b"x").await.is_err() {
                    *one = stuck(&at, 1, &said).await.remove(0);
                }
            }
        }
    }))
}

#[tokio::test(flavor = "multi_thread")]
async fn with_hundreds_of_connections_of_one_computer_a_stop_takes_less_than_two_seconds() {
    for with_token in [false, true] {
        let rig = Rig::quiet().await;
        let driver = match with_token {
            true => bearer(&token(&rig, "pad", "driver").await),
            false => String::new(),
        };
        rig.file("script.lua", "while true do robot.move(30, 30, 0.5) end");
        let run = rig.spykee(&[
            "run",
            "script.lua",
            "--robot",
            &rig.address,
            "--live=127.0.0.1:0",
        ]);
        let at = address(&run).await;
        rig.heard_motion(0).await;
        let slow_login = format!(
            "POST /api/login HTTP/1.1\r\nHost: {at}\r\nContent-Type: application/json\r\n\
             Content-Length: 8000\r\n\r\n{{"
        );
        let slow_stop =
            format!("POST /api/stop HTTP/1.1\r\nHost: {at}\r\nContent-Length: 9\r\n\r\n");
        for (count, said) in [
            (97, ""),
            (300, "GET / HTTP/1.1\r\nX: "),
            (300, &*slow_login),
            (300, &*slow_stop),
        ] {
            let crowd = dripping(&at, count, said);
            sleep(Duration::from_millis(1500)).await;
            let what = format!("{count} times {said:.25?}, token: {with_token}");
            if !said.contains("stop") || with_token {
                stops_in_time(&rig, &at, &driver, &what).await;
            }
            drop(crowd);
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_viewer_with_waiting_pictures_logins_and_pages_does_not_shut_out_the_driver() {
    let options = Options {
        fps: Some(0.1),
        ..Options::default()
    };
    let world = World::from_yaml(QUIET_WORLD, "quiet.yaml").unwrap();
    let rig = Rig::with(world, options).await;
    let shown = token(&rig, "tv", "viewer").await;
    let viewer = bearer(&shown);
    let other = bearer(&token(&rig, "kitchen", "viewer").await);
    let driver = bearer(&token(&rig, "pad", "driver").await);
    rig.file("script.lua", "while true do robot.move(30, 30, 0.5) end");
    let run = rig.spykee(&[
        "run",
        "script.lua",
        "--robot",
        &rig.address,
        "--live=127.0.0.1:0",
    ]);
    let at = address(&run).await;
    rig.heard_motion(0).await;

    let mut waiting = JoinSet::new();
    for _ in 0..110 {
        let (at, viewer) = (at.clone(), viewer.clone());
        waiting.spawn(async move { ask(&at, "GET /api/picture?seconds=600", &viewer, "").await });
    }
    sleep(Duration::from_millis(500)).await;
    stops_in_time(&rig, &at, &driver, "110 waiting pictures").await;

    let login = serde_json::json!({ "token": shown }).to_string();
    for _ in 0..257 {
        assert_eq!(ask(&at, "POST /api/login", "", &login).await.0, 200);
    }
    until_status(&at, &driver, 200).await;
    stops_in_time(&rig, &at, &driver, "257 logins").await;

    let mut pages = Vec::new();
    for _ in 0..32 {
        pages.push(Page::open(&at, &viewer).await.unwrap());
    }
    assert_eq!(Page::open(&at, &viewer).await.err(), Some(503));
    assert!(Page::open(&at, &other).await.is_ok(), "another viewer");
    let mut page = Page::open(&at, &driver).await.unwrap();
    page.send_text("{\"type\":\"drive_lock\",\"take\":true}")
        .await;
    page.until("state", |state| !state["driver"].is_null())
        .await;
    // However many more the viewer opens, the driver's page stays.
    for _ in 0..32 {
        let _ = Page::open(&at, &viewer).await;
    }
    let from = rig.sim.heard_count();
    page.send_text("{\"type\":\"stop\"}").await;
    page.until("state", |state| state["emergency_stop"] == true)
        .await;
    rig.heard_stop(from).await;
    let from = rig.sim.heard_count();
    page.send_text("{\"type\":\"reset_stop\"}").await;
    rig.heard_motion(from).await;
    stops_in_time(&rig, &at, &driver, "32 pages").await;
}
