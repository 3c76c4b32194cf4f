//! The chapters about the service, followed as a new owner would: each command in order, with
//! the scripts and the config of the book.

use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::time::Instant;

use rustix::process::Signal;

use super::commands::words;
use super::{Chapter, behaviours, chapter};
use crate::live::get;
use crate::mqtt::Broker;
use crate::notify::Webhook;
use crate::rig::{Rig, Run, WAIT_LIMIT};

/// Texts that the output of some commands must contain.
const SAYS: &[(&str, &str)] = &[
    (
        "spykee serve --sim --fast",
        "the idle robot is on its station",
    ),
    (
        "spykee serve --sim --fast",
        "planned for Mon 2026-05-04 18:00",
    ),
    ("spykee status", "cuckoo Mon 2026-05-04 22:00"),
    ("spykee behaviour list", "visitor"),
    ("spykee history runs", "my_patrol"),
    ("spykee config test-notify", "phone: sent"),
    ("spykee config test-notify --config", "family: sent"),
    ("spykee config test-notify --config", "house: sent"),
    ("curl http://127.0.0.1:7788/healthz", "\"ready\":true"),
    ("curl http://127.0.0.1:7788/metrics", "spykee_link_up 1"),
    ("spykee robot battery", "%"),
    ("spykee token new", "spykee_"),
    ("spykee fleet list", "ONLINE"),
    ("spykee fleet run", ": done"),
    ("spykee fleet stop", ": done"),
];

fn service() -> &'static Chapter {
    chapter("operate/service.md")
}

fn notifications() -> &'static Chapter {
    chapter("operate/notifications.md")
}

/// A home with the scripts of the book, a webhook that is notified, and a broker if mosquitto is
/// installed.
struct Owner {
    rig: Rig,
    port: u16,
    told: Webhook,
    broker: Option<Broker>,
    service: Option<Run>,
    installed: String,
}

impl Owner {
    async fn new() -> Owner {
        let rig = Rig::quiet().await;
        let behaviours = behaviours();
        for (name, key) in [
            ("my_patrol.lua", "17"),
            ("visitor.lua", "journal"),
            ("cuckoo.lua", "service"),
        ] {
            rig.file(name, behaviours[key]);
        }
        for name in ["ntfy.topic", "apprise.key", "webhook.id", "mqtt.password"] {
            let path = rig.file(name, "secret");
            std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
        }
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let users = "allow_anonymous false\npassword_file @/users\n";
        let owner = Owner {
            rig,
            port: free.local_addr().unwrap().port(),
            told: Webhook::start(&[200]),
            broker: Broker::start_with(users, &[("rover", "secret")]),
            service: None,
            installed: String::new(),
        };
        owner.writes(&[service().blocks("yaml")[0].to_owned()]);
        owner
    }

    fn writes(&self, config: &[String]) {
        self.rig.file("spykee.yaml", &config.concat());
    }

    /// Writes the config with all settings from the page for this computer; hosts are replaced by
    /// local ones.
    fn completes_the_config(&self) {
        let said = service().blocks("yaml");
        let [first, page, remote, broker] = said[..] else {
            panic!("{said:?}");
        };
        assert!(
            remote.starts_with("remote:"),
            "of another computer: {remote}"
        );
        let here = |line: &str| match line.trim().strip_prefix("url: ") {
            Some(url) => {
                let path = url.splitn(4, '/').nth(3).unwrap();
                format!("      url: http://{}/{path}\n", self.told.address)
            }
            None => format!("{line}\n"),
        };
        let notify = notifications().blocks("yaml")[0]
            .lines()
            .map(here)
            .collect();
        let broker = self.broker.as_ref().map(|one| {
            let host = format!("host: 127.0.0.1\n  port: {}", one.port);
            broker.replace("host: broker.local", &host)
        });
        let page = page.replace("7788", &self.port.to_string());
        self.writes(&[first.to_owned(), page, broker.unwrap_or_default(), notify]);
    }

    async fn types(&mut self, command: &str) {
        let typed = command.replace("7788", &self.port.to_string());
        let words = words(&typed);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let said = match words[..] {
            ["spykee", "fleet", ..] if self.broker.is_none() => return,
            ["spykee", "serve", ref rest @ ..] if !rest.contains(&"--fast") => {
                self.completes_the_config();
                let run = self.rig.spykee(&words[1..]);
                run.says("the page is at").await;
                run.says("starts by the timetable").await;
                if self.broker.is_some() {
                    run.says("is connected to the broker").await;
                }
                self.service = Some(run);
                return;
            }
            ["spykee", ref rest @ ..] => self.run_spykee(rest).await,
            ["curl", url] => {
                let (at, path) = url.trim_start_matches("http://").split_once('/').unwrap();
                let (status, body) = get(at, &format!("/{path}")).await;
                assert_eq!(status, 200, "{command}: {body}");
                body
            }
            ["sudo", "install", ref rest @ ..] => {
                let ours = |word: &&&str| word.ends_with(".lua") || word.ends_with(".yaml");
                for file in rest.iter().filter(ours) {
                    assert!(self.rig.folder().join(file).exists(), "{command}");
                }
                return;
            }
            ["sudo", "/usr/local/bin/spykee", ref rest @ ..] => {
                let unit = self.rig.folder().join("spykee.service");
                let more = ["--to", unit.to_str().unwrap(), "--program", "/usr/bin/env"];
                self.installed = self.run_spykee(&[rest, &more].concat()).await;
                return;
            }
            ["sudo", "systemctl", ..] => {
                let said = &self.installed;
                return assert!(said.contains(command), "{command}: {said}");
            }
            _ => panic!("this test cannot run `{command}`"),
        };
        for (_, wanted) in SAYS
            .iter()
            .filter(|(begins, _)| command.starts_with(begins))
        {
            if !self.tells(&words, &said, wanted).await {
                panic!("{command}: {said}");
            }
        }
        if command.starts_with("spykee config schedule") {
            assert_eq!(said.trim(), service().blocks("text")[0].trim());
        }
    }

    /// Whether the output contains this; commands that list a state are repeated until it appears.
    async fn tells(&self, words: &[&str], said: &str, wanted: &str) -> bool {
        let asks = matches!(words[1..], ["status" | "history", ..] | [_, "list", ..]);
        let until = Instant::now() + WAIT_LIMIT;
        let mut known = said.contains(wanted);
        while asks && !known && Instant::now() < until {
            known = self.run_spykee(&words[1..]).await.contains(wanted);
        }
        known
    }

    async fn run_spykee(&self, args: &[&str]) -> String {
        let mut run = self.rig.spykee(args);
        let code = run.code().await;
        let log = self.service.as_ref().map(Run::text).unwrap_or_default();
        assert_eq!(code, Some(0), "{args:?}: {}\n{log}", run.text());
        run.text()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_owner_follows_the_steps_about_the_service() {
    let mut owner = Owner::new().await;
    let typed = service().commands();
    for (begins, _) in SAYS {
        assert!(typed.iter().any(|one| one.starts_with(begins)), "{begins}");
    }
    for command in typed {
        owner.types(command).await;
    }
    let mut service = owner.service.take().unwrap();
    service.signal(Signal::TERM);
    assert_eq!(service.code().await, Some(0), "{}", service.text());
    // A run with today's date and a journal, which the chapter on the journal mentions.
    let config = std::fs::read_to_string(owner.rig.folder().join("spykee.yaml")).unwrap();
    let today = "data: today\njournal: { record: on }\n".to_owned();
    owner.writes(&[config, today]);
    let run = "run visitor.lua --sim --for 3 --config spykee.yaml";
    let run: Vec<&str> = run.split(' ').collect();
    owner.run_spykee(&run).await;
    let journal = chapter("operate/journal.md").commands();
    for command in journal.into_iter().chain(notifications().commands()) {
        owner.types(command).await;
    }
}
