//! Servers of webhooks that hang, never end, or redirect elsewhere.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::time::Duration;

use super::{DRIVES, drove_on};
use crate::notify::Webhook;
use crate::rig::{Rig, Run, assert_contains};

const TOKEN: &str = "s3cr3t-t0ken";

/// The reaction of a server to a connection, after it has read something.
type Reaction = fn(&mut TcpStream, &str);

fn say(stream: &mut TcpStream, text: &str) {
    let _ = stream.write_all(text.as_bytes());
}

/// Sends until the client closes the connection.
fn pour(stream: &mut TcpStream, first: &str, more: &[u8]) {
    say(stream, first);
    while stream.write_all(more).is_ok() {}
}

fn hang(stream: &mut TcpStream) {
    let mut rest = [0; 4096];
    while matches!(stream.read(&mut rest), Ok(1..)) {}
}

fn redirect(stream: &mut TcpStream, status: u16, to: &str) {
    say(
        stream,
        &format!(
            "HTTP/1.1 {status} X\r\nlocation: {to}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
        ),
    );
}

/// The reactions of servers.
const REACTIONS: &[(&str, Reaction)] = &[
    ("closes the connection at once", |_, _| {}),
    ("sends nothing", |stream, _| hang(stream)),
    ("sends half a line", |stream, _| {
        say(stream, "HTTP/1.1 2");
        hang(stream);
    }),
    ("sends one byte at a time", |stream, _| {
        for letter in "HTTP/1.1 200 OK\r\nx: y"
            .chars()
            .chain(std::iter::repeat('y'))
        {
            if stream.write_all(&[letter as u8]).is_err() {
                break;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }),
    ("speaks another protocol", |stream, _| {
        pour(stream, "SSH-2.0-OpenSSH_9.2\r\n", &[0; 4096])
    }),
    ("sends an endless head", |stream, _| {
        pour(stream, "HTTP/1.1 200 OK\r\n", b"x-more: and more\r\n")
    }),
    ("sends an endless line", |stream, _| {
        pour(stream, "HTTP/1.1 200 OK\r\nx: ", &[b'y'; 4096])
    }),
    ("sends an invalid status", |stream, _| {
        say(stream, "HTTP/1.1 99999 OK\r\n\r\n")
    }),
    ("sends interim responses endlessly", |stream, _| {
        pour(stream, "", b"HTTP/1.1 100 Continue\r\n\r\n");
    }),
    ("fails with an endless page", |stream, _| {
        pour(
            stream,
            "HTTP/1.1 500 X\r\ntransfer-encoding: chunked\r\n\r\n",
            b"4\r\nmore\r\n",
        );
    }),
    ("redirects to itself", |stream, own| {
        redirect(stream, 307, own)
    }),
    ("redirects endlessly", |stream, own| {
        redirect(stream, 303, &format!("{own}?{}", rand::random::<u32>()));
    }),
    ("redirects to a file", |stream, _| {
        redirect(stream, 302, "file:///etc/passwd")
    }),
    ("redirects to a closed port", |stream, _| {
        redirect(stream, 302, "http://127.0.0.1:1/")
    }),
    ("redirects to an invalid address", |stream, _| {
        redirect(stream, 301, "::\u{1}//")
    }),
    ("redirects with an injected line", |stream, _| {
        redirect(stream, 302, "http://a/\r\nx: y")
    }),
    ("refuses with escape sequences", |stream, _| {
        say(
            stream,
            "HTTP/1.1 418 \u{1b}[2J\u{202e}\r\ncontent-length: 0\r\n\r\n",
        );
    }),
];

/// Starts a server with this reaction; returns its address.
fn serve(reaction: Reaction) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/hook", listener.local_addr().unwrap());
    let own = address.clone();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            let own = own.clone();
            std::thread::spawn(move || {
                let _ = stream.read(&mut [0; 4096]);
                reaction(&mut stream, &own);
            });
        }
    });
    address
}

fn config(rig: &Rig, targets: &str, rest: &str) -> String {
    let path = rig.file("token", TOKEN);
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
    format!("data: data\n{rest}notify: {{ targets: {{ {targets} }} }}\n")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_hangs_never_ends_or_redirects_times_out() {
    let rig = Rig::quiet().await;
    for (number, (_, reaction)) in REACTIONS.iter().enumerate() {
        let address = serve(*reaction);
        let target = format!(
            "hook: {{ url: '{address}?{{token}}', token_file: token, headers: {{ X-Token: '{{token}}' }} }}"
        );
        rig.file(&format!("hook{number}.yaml"), &config(&rig, &target, ""));
    }
    let tests: Vec<Run> = (0..REACTIONS.len())
        .map(|number| format!("hook{number}.yaml"))
        .map(|file| rig.spykee(&["config", "test-notify", "--config", &file]))
        .collect();
    for ((what, _), mut test) in REACTIONS.iter().zip(tests) {
        let code = test.code().await;
        let text = test.text();
        assert_eq!(code, Some(4), "it {what}: {text}");
        assert!(text.contains("hook: not sent: "), "it {what}: {text}");
        assert!(
            !text.contains(TOKEN) && !text.contains('\u{1b}'),
            "it {what}: {text}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_redirect_takes_no_secret_to_another_host() {
    let rig = Rig::quiet().await;
    let other = Webhook::start(&[200]);
    let to = format!("http://{}/", other.address);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            let _ = stream.read(&mut [0; 4096]);
            redirect(&mut stream, 307, &to);
        }
    });
    let target = format!(
        "hook: {{ url: 'http://{address}/', token_file: token, headers: {{ X-Token: '{{token}}' }} }}"
    );
    rig.file("hook.yaml", &config(&rig, &target, ""));
    let mut test = rig.spykee(&["config", "test-notify", "--config", "hook.yaml"]);
    assert_eq!(test.code().await, Some(4), "{}", test.text());
    assert_contains(&test.text(), &["it redirects to another address"]);
    assert!(other.asked().is_empty(), "{:?}", other.asked());
}

#[tokio::test(flavor = "multi_thread")]
async fn any_number_of_malicious_servers_neither_stops_the_robot_nor_delays_the_end() {
    let rig = Rig::quiet().await;
    let hooks = REACTIONS.iter().take(8).enumerate();
    let hooks: Vec<String> = hooks
        .map(|(number, (_, reaction))| format!("hook{number}: {{ url: '{}' }}", serve(*reaction)))
        .collect();
    rig.file("script.lua", &format!("notify.send('hello') {DRIVES}"));
    let rest = "behaviours: [{ file: script.lua }]\n";
    let mut run = rig.run_config(&config(&rig, &hooks.join(", "), rest));
    let from = rig.heard_motion(0).await;
    run.says("notification not sent yet").await;
    drove_on(&rig, &mut run, from, "servers").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_form_has_exactly_the_fields_of_the_config() {
    let rig = Rig::quiet().await;
    let (asked, heard) = std::sync::mpsc::channel();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            let mut all = Vec::new();
            let mut part = [0; 65536];
            stream
                .set_read_timeout(Some(Duration::from_secs(1)))
                .unwrap();
            while let Ok(count @ 1..) = stream.read(&mut part) {
                all.extend_from_slice(&part[..count]);
            }
            say(&mut stream, "HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n");
            let _ = asked.send(all);
        }
    });
    let field =
        "\r\n--BOUNDARY\r\nContent-Disposition: form-data; name=\"urls\"\r\n\r\nmailto://evil\r\n";
    // A fixed boundary could be read in the source of the program, as this one of an earlier version.
    let field = field.replace("BOUNDARY", "spykee-5f1d8a7c40b2496e9d3e-form");
    let mut picture = std::fs::read("tests/fixtures/ball-420.jpg").unwrap();
    picture.extend_from_slice(field.as_bytes());
    std::fs::write(rig.folder().join("seen.jpg"), &picture).unwrap();
    let target = format!(
        "hook: {{ url: 'http://{address}/', picture: form, json: {{ body: '{{text}}' }} }}"
    );
    rig.file("hook.yaml", &config(&rig, &target, ""));
    let nested = field.replace("8a7c", "8aspykee-5f1d8a7c40b2496e9d3e-form7c");
    for text in [&*field, &*nested] {
        let args = [
            "config",
            "test-notify",
            "--config",
            "hook.yaml",
            "--text",
            text,
            "--picture",
            "seen.jpg",
        ];
        let mut test = rig.spykee(&args);
        assert_eq!(test.code().await, Some(0), "{}", test.text());
        let sent = heard.recv_timeout(crate::rig::WAIT_LIMIT).unwrap();
        let sent = String::from_utf8_lossy(&sent);
        let boundary = sent
            .split_once("boundary=")
            .unwrap()
            .1
            .split("\r\n")
            .next()
            .unwrap();
        let parts = sent.matches(&format!("\r\n--{boundary}\r\n")).count();
        assert_eq!(parts, 2, "a field that is not in the config:\n{sent}");
    }
}
