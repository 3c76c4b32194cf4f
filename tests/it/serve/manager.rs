//! The interface to the service manager: real systemd, or a socket in its place.

use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use tokio::time::timeout;

use super::{DRIVES, config, ends_well, run_spykee, succeed};
use crate::guardian::thread_called;
use crate::notify::Webhook;
use crate::rig::{Rig, WAIT_LIMIT, assert_contains};
use crate::slow_system::trace;

#[tokio::test(flavor = "multi_thread")]
async fn the_service_manager_is_notified_of_ready_and_alive() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    config(&rig, "", "behaviours:\n- file: drive.lua\n");
    let path = rig.folder().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(WAIT_LIMIT)).unwrap();
    let environment = [
        ("NOTIFY_SOCKET", path.to_str().unwrap()),
        ("WATCHDOG_USEC", "400000"),
    ];
    let args = ["serve", "--config", "spykee.yaml", "--robot", &rig.address];
    let mut run = rig.spykee_with(&args, &environment);
    let hear_all = tokio::task::spawn_blocking(move || {
        let mut heard = String::new();
        let mut alive = 0;
        while alive < 3 || !(heard.contains("READY=1") && heard.contains("; drive")) {
            let mut buffer = [0; 1024];
            let length = socket
                .recv(&mut buffer)
                .unwrap_or_else(|_| panic!("{heard}"));
            let text = String::from_utf8_lossy(&buffer[..length]);
            alive += usize::from(text.contains("WATCHDOG=1"));
            heard += &text;
        }
    });
    hear_all.await.unwrap();
    ends_well(&mut run).await;
}

/// The driving thread does not return from a wait, while all others continue.
#[tokio::test(flavor = "multi_thread")]
async fn the_service_manager_gets_no_heartbeat_if_the_driving_thread_hangs() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    config(&rig, "", "behaviours:\n- file: drive.lua\n");
    let path = rig.folder().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_nonblocking(true).unwrap();
    let environment = [
        ("NOTIFY_SOCKET", path.to_str().unwrap()),
        ("WATCHDOG_USEC", "400000"),
    ];
    let args = ["serve", "--config", "spykee.yaml", "--robot", &rig.address];
    let run = rig.spykee_with(&args, &environment);
    let alive = || {
        let mut buffer = [0; 1024];
        let mut count = 0;
        while let Ok(length) = socket.recv(&mut buffer) {
            count += usize::from(buffer[..length].starts_with(b"WATCHDOG=1"));
        }
        count
    };
    rig.heard_motion(0).await;
    let beats = async {
        while alive() == 0 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    timeout(WAIT_LIMIT, beats).await.expect("no heartbeat");
    let core = thread_called(run.pid(), "core");
    let hang = "inject=epoll_wait:delay_exit=8000000";
    let Some(mut tracer) = trace(core, &["-e", "trace=epoll_wait", "-e", hang]) else {
        return;
    };
    // The guardian has noticed it.
    rig.heard_stop(rig.sim.heard_count()).await;
    let silent = async {
        loop {
            alive();
            // Ten times the interval of the heartbeat.
            tokio::time::sleep(Duration::from_secs(1)).await;
            if alive() == 0 {
                return;
            }
        }
    };
    let silent = timeout(WAIT_LIMIT, silent).await;
    let _ = tracer.kill();
    let _ = tracer.wait();
    assert!(silent.is_ok(), "it beats on");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_unit_has_few_rights() {
    let rig = Rig::quiet().await;
    let unit = rig.folder().join("spykee.service");
    let path = unit.to_str().unwrap();
    let install = [
        "service",
        "install",
        "--to",
        path,
        "--program",
        "/usr/bin/env",
        "--password-file",
        "/etc/hostname",
    ];
    let text = succeed(&rig, &install).await;
    assert_contains(&text, &["systemctl enable"]);
    let (code, text) = run_spykee(&rig, &install).await;
    assert_eq!(code, Some(2), "{text}");
    assert_contains(&text, &["--force"]);
    let text = std::fs::read_to_string(&unit).unwrap();
    assert!(text.contains("ExecStart=/usr/bin/env serve --config /etc/spykee/spykee.yaml"));
    assert!(text.contains("LoadCredential=password:/etc/hostname"));
    let print = [&["service", "print"], &install[4..]].concat();
    assert_eq!(
        run_spykee(&rig, &print).await,
        (Some(0), text.trim_end().into())
    );
    let analyzed = std::process::Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--threshold=20", path])
        .output();
    match analyzed {
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success(), "{text}");
        }
        Err(_) => println!("no systemd-analyze here: its verdict was not asked for"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_password_may_come_from_the_service_managers_credentials() {
    let rig = Rig::quiet().await;
    config(&rig, "", "");
    rig.file("password", "wrong\n");
    let environment = [("CREDENTIALS_DIRECTORY", rig.folder().to_str().unwrap())];
    let args = ["serve", "--config", "spykee.yaml", "--robot", &rig.address];
    let mut run = rig.spykee_with(&args, &environment);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    assert_contains(&run.text(), &["refuses user `admin`"]);
    rig.file("password", "admin\n");
    let mut run = rig.spykee_with(&args, &environment);
    run.says("connected").await;
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_secret_of_a_config_may_belong_to_root_because_systemd_passes_it() {
    let rig = Rig::quiet().await;
    let hook = Webhook::start(&[200]);
    let phone = format!(
        "notify: {{ targets: {{ phone: {{ url: 'http://{}/{{token}}', token_file: phone.topic }} }} }}\n",
        hook.address
    );
    let broker = "mqtt: { host: 127.0.0.1, user: anna, password_file: mqtt.password }\n";
    let path = rig.file("spykee.yaml", &format!("{phone}{broker}"));
    let path = path.to_str().unwrap();
    let print = [
        "service",
        "print",
        "--config",
        path,
        "--program",
        "/usr/bin/env",
    ];
    let text = succeed(&rig, &print).await;
    let folder = rig.folder().to_str().unwrap().to_owned();
    let name = |file: &str| {
        let path = format!("{folder}/{file}");
        path.trim_start_matches('/').replace(['/', '-'], "-")
    };
    for file in ["phone.topic", "mqtt.password"] {
        let line = format!("LoadCredential={}:{folder}/{file}\n", name(file));
        assert!(text.contains(&line), "{line}: {text}");
    }
    // The file itself is not there: the service reads the copy.
    rig.file(&name("phone.topic"), "secret-topic\n");
    let args = ["config", "test-notify", "phone", "--config", path];
    let environment = [("CREDENTIALS_DIRECTORY", folder.as_str())];
    let mut run = rig.spykee_with(&args, &environment);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert!(hook.asked()[0].head.contains("/secret-topic"));
}
