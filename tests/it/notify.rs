//! Notifications of real runs to real HTTP servers that answer, refuse, hang or do not exist.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::process::Signal;
use spykee::wire::{Command, Led};

use crate::rig::{QUIET_WORLD, Rig, Run, WAIT_LIMIT, assert_contains, state_of};

/// A request as it arrived.
#[derive(Debug, Clone)]
pub struct ReceivedRequest {
    pub head: String,
    body: Vec<u8>,
}

impl ReceivedRequest {
    fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

/// A server that answers each request with the next status, and then repeats the last one; 0 means
/// no answer.
pub struct Webhook {
    pub address: String,
    asked: Arc<Mutex<Vec<ReceivedRequest>>>,
}

impl Webhook {
    pub fn start(statuses: &'static [u16]) -> Webhook {
        Webhook::on(TcpListener::bind("127.0.0.1:0").unwrap(), statuses)
    }

    fn on(listener: TcpListener, statuses: &'static [u16]) -> Webhook {
        let address = listener.local_addr().unwrap().to_string();
        let asked = Arc::new(Mutex::new(Vec::new()));
        let kept = asked.clone();
        std::thread::spawn(move || {
            let mut hanging = Vec::new();
            for stream in listener.incoming().map_while(Result::ok) {
                let mut reader = BufReader::new(stream);
                let Some(one) = read(&mut reader) else {
                    continue;
                };
                let count = {
                    let mut asked: std::sync::MutexGuard<'_, Vec<ReceivedRequest>> =
                        kept.lock().unwrap();
                    asked.push(one);
                    asked.len()
                };
                let status = statuses[(count - 1).min(statuses.len() - 1)];
                let mut stream = reader.into_inner();
                if status == 0 {
                    hanging.push(stream);
                    continue;
                }
                let answer = format!(
                    "HTTP/1.1 {status} X\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
                );
                let _ = stream.write_all(answer.as_bytes());
            }
        });
        Webhook { address, asked }
    }

    pub fn asked(&self) -> Vec<ReceivedRequest> {
        self.asked.lock().unwrap().clone()
    }

    /// Waits for this many requests.
    async fn wait(&self, count: usize) -> Vec<ReceivedRequest> {
        let until = Instant::now() + WAIT_LIMIT;
        while self.asked().len() < count {
            assert!(Instant::now() < until, "instead: {:?}", self.asked());
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        self.asked()
    }
}

fn read(reader: &mut impl BufRead) -> Option<ReceivedRequest> {
    let mut head = String::new();
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line).ok()? == 0 {
            return None;
        }
        if line == "\r\n" {
            break;
        }
        head += &line;
    }
    let length = head.to_lowercase();
    let length = length
        .lines()
        .find_map(|line| line.strip_prefix("content-length:"));
    let mut body = vec![
        0;
        length
            .and_then(|text| text.trim().parse().ok())
            .unwrap_or(0)
    ];
    reader.read_exact(&mut body).ok()?;
    Some(ReceivedRequest { head, body })
}

fn secret(rig: &Rig, text: &str) {
    let path = rig.file("token", text);
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
}

fn start(rig: &Rig, notify: &str, script: &str) -> Run {
    rig.file("one.lua", script);
    rig.run_config(&format!(
        "data: data\nbehaviours: [{{ file: one.lua }}]\n{notify}"
    ))
}

fn waiting(rig: &Rig, target: &str) -> usize {
    let folder = rig.folder().join("data/.notify").join(target);
    std::fs::read_dir(folder).map_or(0, |files| files.count())
}

#[tokio::test(flavor = "multi_thread")]
async fn messages_of_scripts_and_failures_reach_a_webhook_and_no_log_contains_its_secret() {
    let rig = Rig::quiet().await;
    let hook = Webhook::start(&[200]);
    secret(&rig, "s3cr3t\n");
    let notify = format!(
        "notify: {{ targets: {{ phone: {{ url: 'http://{}/{{token}}', token_file: token, picture: body,
         headers: {{ Authorization: 'Bearer {{token}}', Message: '{{robot}}: {{text}}' }} }} }} }}",
        hook.address
    );
    let script = "local path = robot.wait_frame(20):save('seen')
        print(notify.send('look at this', {picture = path}))
        error('no')";
    let mut run = start(&rig, &notify, script);
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    let asked = hook.wait(2).await;
    let [picture, failure] = &asked[..] else {
        panic!("{asked:?}");
    };
    assert!(picture.body.starts_with(&[0xff, 0xd8]));
    let head = picture.head.to_lowercase();
    assert!(
        head.starts_with("post /s3cr3t http") && head.contains("bearer s3cr3t"),
        "{head}"
    );
    assert_contains(&head, &["message: spykee: look at this"]);
    assert_contains(&failure.text(), &["one failed: one.lua:3"]);
    assert!(!run.text().contains("s3cr3t"), "{}", run.text());
    assert_eq!(waiting(&rig, "phone"), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_webhook_that_fails_receives_the_message_after_a_pause() {
    let rig = Rig::quiet().await;
    let hook = Webhook::start(&[500, 200]);
    let notify = format!(
        "notify: {{ targets: {{ phone: {{ url: 'http://{}/' }} }} }}",
        hook.address
    );
    let run = start(&rig, &notify, "notify.send('hello') task.wait(600)");
    let asked = hook.wait(2).await;
    assert_eq!(
        (asked[0].text(), asked[1].text()),
        ("hello".into(), "hello".into())
    );
    run.says("it responds with the status 500").await;
    run.says("notification sent").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_for_an_unreachable_webhook_survives_the_end_of_the_run() {
    let rig = Rig::quiet().await;
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let notify = format!("notify: {{ targets: {{ phone: {{ url: 'http://{address}/' }} }} }}");
    let mut run = start(&rig, &notify, "notify.send('hello')");
    assert_eq!(run.code().await, Some(0));
    assert_contains(&run.text(), &["not sent yet"]);
    assert_eq!(waiting(&rig, "phone"), 1);
    let hook = Webhook::on(TcpListener::bind(address).unwrap(), &[200]);
    let mut run = start(&rig, &notify, "task.wait(1)");
    assert_eq!(hook.wait(1).await[0].text(), "hello");
    assert_eq!(run.code().await, Some(0));
    assert_eq!(waiting(&rig, "phone"), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_webhook_that_hangs_delays_neither_the_robot_nor_other_targets_nor_the_end() {
    let rig = Rig::quiet().await;
    let hook = Webhook::start(&[0]);
    let told = rig.folder().join("told");
    let notify = format!(
        "notify: {{ targets: {{ phone: {{ url: 'http://{}/' }},
         desk: {{ command: [sh, -c, 'cat > {}'] }} }} }}",
        hook.address,
        told.display()
    );
    let script = "notify.send('hello') while true do robot.led('left', true) task.wait(0.1) robot.led('left', false) task.wait(0.1) end";
    let mut run = start(&rig, &notify, script);
    hook.wait(1).await;
    run.says("notification sent").await;
    assert_eq!(std::fs::read_to_string(&told).unwrap(), "hello");
    let mut from = rig.sim.heard_since(0).len();
    for on in [true, false, true, false, true] {
        let light = move |command: &Command| *command == Command::Led { led: Led::Left, on };
        from = rig.heard(from, light).await + 1;
    }
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130));
    assert_eq!(waiting(&rig, "phone"), 1, "the message is not in the queue");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_program_that_hangs_ends_with_the_run_and_its_message_waits_for_the_next() {
    let rig = Rig::quiet().await;
    let file = rig.folder().join("pid");
    let notify = format!(
        "notify: {{ targets: {{ desk: {{ command: [sh, -c, 'echo $$ > {}; exec sleep 600'] }} }} }}",
        file.display()
    );
    let mut run = start(&rig, &notify, "notify.send('hello') task.wait(600)");
    let until = Instant::now() + WAIT_LIMIT;
    let program = loop {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        if let Some(number) = text.strip_suffix('\n') {
            break rustix::process::Pid::from_raw(number.parse().unwrap()).unwrap();
        }
        assert!(Instant::now() < until, "not started:\n{}", run.text());
        tokio::time::sleep(Duration::from_millis(20)).await;
    };
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130));
    let state = state_of(program);
    if state != '?' {
        let _ = rustix::process::kill_process_group(program, Signal::KILL);
        panic!("it still runs in state {state}");
    }
    assert_eq!(waiting(&rig, "desk"), 1, "the message is not in the queue");
}

#[tokio::test(flavor = "multi_thread")]
async fn people_are_notified_of_a_missed_start_and_of_a_robot_that_is_gone_and_back() {
    let options = spykee::sim::Options {
        faults: Some(Vec::new()),
        ..spykee::sim::Options::default()
    };
    let world = spykee::sim::World::from_yaml(QUIET_WORLD, "test").unwrap();
    let rig = Rig::with(world, options).await;
    let hook = Webhook::start(&[200]);
    rig.file("busy.lua", "task.wait(600)");
    rig.file(
        "spykee.yaml",
        &format!(
            "time_zone: UTC\nservice: {{ user: root }}\n\
             behaviours: [{{ file: busy.lua, start: always }}]\n\
             schedule: [{{ run: busy, at: '* * * * *' }}]\n\
             notify: {{ unreachable_after: 1, targets: {{ phone: {{ url: 'http://{}/', \
             on: [start_missed, unreachable] }} }} }}\n",
            hook.address
        ),
    );
    let mut run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    let hears = async |words: &str| {
        let until = Instant::now() + WAIT_LIMIT;
        while !hook.asked().iter().any(|one| one.text().contains(words)) {
            assert!(Instant::now() < until, "{words}: {:?}", hook.asked());
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    // Its start was due in the minutes before.
    hears("busy did not start: the service did not run then").await;
    let gone = "faults: [{ fault: reboot, for: 5, state: kept }]";
    let faults = spykee::sim::Fault::list_from_yaml(gone, "gone").unwrap();
    faults.into_iter().for_each(|fault| rig.sim.begin(fault));
    hears("has been out of reach for").await;
    hears("is in reach again").await;
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_of_messages_is_limited_for_each_target() {
    let rig = Rig::quiet().await;
    let hook = Webhook::start(&[200]);
    let notify = format!(
        "notify: {{ targets: {{ phone: {{ url: 'http://{}/', on: [script] }} }} }}",
        hook.address
    );
    // A script may send five messages at once, a target gets ten.
    for name in ["one", "two", "three"] {
        let script = format!("for n = 1, 5 do notify.send('{name} ' .. n) end error('not told')");
        rig.file(&format!("{name}.lua"), &script);
    }
    let behaviours = "[{ file: one.lua }, { file: two.lua }, { file: three.lua }]";
    let config = format!("data: data\nbehaviours: {behaviours}\n{notify}");
    let mut run = rig.run_config(&config);
    assert_eq!(run.code().await, Some(1));
    let asked = hook.asked();
    assert_eq!(asked.len(), 10, "{asked:?}");
    assert!(asked.iter().all(|one| !one.text().contains("not told")));
}

#[tokio::test(flavor = "multi_thread")]
async fn notify_test_reports_its_result_and_a_found_config_starts_no_program() {
    let rig = Rig::quiet().await;
    let hook = Webhook::start(&[200, 404]);
    rig.file(
        "spykee.yaml",
        &format!(
            "time_zone: Asia/Tokyo\nnotify: {{ targets: {{ phone: {{ url: 'http://{}/', picture: body, \
             headers: {{ Title: '{{title}}, {{time}}' }} }}, desk: {{ command: ['true'] }} }} }}",
            hook.address
        ),
    );
    let named = ["--config", "spykee.yaml"];
    let test = async |args: &[&str]| {
        let mut run = rig.spykee(&[&["config", "test-notify"], args].concat());
        (run.code().await, run.text())
    };
    let (code, text) = test(&named).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(&text, &["phone: sent", "desk: sent"]);
    let (code, text) = test(&[&["phone"], &named[..]].concat()).await;
    assert!(
        code == Some(4) && text.contains("phone: not sent: it responds with the status 404"),
        "{text}"
    );
    let (code, text) = test(&[&["fax"], &named[..]].concat()).await;
    assert!(code == Some(2) && text.contains("desk, phone"), "{text}");
    let (code, text) = test(&[]).await;
    assert!(
        code == Some(2) && text.contains("found in the current folder, not named"),
        "{text}"
    );
    let asked = hook.asked();
    assert_eq!(asked.len(), 2);
    // With a picture, the title in plain words, and the owner's time.
    assert!(asked[0].body.starts_with(&[0xff, 0xd8]));
    assert_contains(&asked[0].head, &["A test, 20", " +09:00"]);
}
