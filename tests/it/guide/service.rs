//! The guide's steps about the service, followed as a new owner would: each command in order, with
//! the scripts and the config of the page.

use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::time::Instant;

use rustix::process::Signal;

use super::{GUIDE, scripts};
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

/// A step of the guide, from its number and title to the next heading of the same level.
fn step(number: u32) -> &'static str {
    let step = GUIDE
        .split("\n## ")
        .find(|text| text.starts_with(&format!("{number}. ")));
    step.unwrap_or_else(|| panic!("no step {number}"))
}

fn blocks(text: &'static str, language: &str) -> Vec<&'static str> {
    let begins = format!("```{language}\n");
    let blocks = text.split(&begins).skip(1);
    blocks
        .map(|block| block.split("```").next().unwrap())
        .collect()
}

/// The indented lines of a text, which are commands.
fn commands(text: &'static str) -> Vec<&'static str> {
    let prose = text.split("```").step_by(2);
    prose
        .flat_map(str::lines)
        .filter_map(|line| line.strip_prefix("    "))
        .collect()
}

/// Splits a command as a shell would, without its redirection into a file.
fn words(command: &str) -> Vec<String> {
    let command = command.split(" > ").next().unwrap();
    let quoted = command.split('"').enumerate();
    let words = quoted.flat_map(|(index, part)| match index % 2 {
        0 => part.split_whitespace().map(str::to_owned).collect(),
        _ => vec![part.to_owned()],
    });
    words.collect()
}

/// A home with the scripts of the guide, a webhook that is notified, and a broker if mosquitto is
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
        let (behaviours, _) = scripts();
        for (name, begins) in [
            ("my_patrol.lua", "-- Drives legs"),
            ("visitor.lua", "-- Listens"),
            ("cuckoo.lua", "-- A cuckoo clock"),
        ] {
            let script = behaviours.iter().find(|script| script.starts_with(begins));
            rig.file(name, script.unwrap_or_else(|| panic!("{name}")));
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
        owner.writes(&[blocks(step(20), "yaml")[0].to_owned()]);
        owner
    }

    fn writes(&self, config: &[String]) {
        self.rig.file("spykee.yaml", &config.concat());
    }

    /// Writes the config with all settings from the page for this computer; hosts are replaced by
    /// local ones.
    fn completes_the_config(&self) {
        let said = blocks(step(20), "yaml");
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
        let notify = blocks(step(19), "yaml")[0].lines().map(here).collect();
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
            assert_eq!(said.trim(), blocks(step(20), "text")[0].trim());
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
    let typed = commands(step(20));
    for (begins, _) in SAYS {
        assert!(typed.iter().any(|one| one.starts_with(begins)), "{begins}");
    }
    for command in typed {
        owner.types(command).await;
    }
    let mut service = owner.service.take().unwrap();
    service.signal(Signal::TERM);
    assert_eq!(service.code().await, Some(0), "{}", service.text());
    // A run with today's date and a journal, which step 19 mentions.
    let config = std::fs::read_to_string(owner.rig.folder().join("spykee.yaml")).unwrap();
    let today = "data: today\njournal: { record: on }\n".to_owned();
    owner.writes(&[config, today]);
    let run = "run visitor.lua --sim --for 3 --config spykee.yaml";
    let run: Vec<&str> = run.split(' ').collect();
    owner.run_spykee(&run).await;
    for command in commands(step(19)) {
        owner.types(command).await;
    }
}

#[test]
fn every_config_of_guide_and_readme_is_read() {
    let readme = include_str!("../../../README.md");
    for (name, page, least) in [("the guide", GUIDE, 5), ("README.md", readme, 4)] {
        let mut configs = 0;
        let yaml = blocks(page, "yaml");
        for block in yaml {
            let read = match block {
                _ if block.starts_with("faults:") => {
                    spykee::sim::Fault::list_from_yaml(block, name)
                        .map(|_| ())
                        .map_err(|error| error.to_string())
                }
                _ if block.starts_with("stops_on_disconnect:") => {
                    spykee::sim::Firmware::from_yaml(block, name)
                        .map(|_| ())
                        .map_err(|error| error.to_string())
                }
                _ => {
                    configs += 1;
                    spykee::config::Config::parse(block, name)
                        .map(|_| ())
                        .map_err(|error| error.to_string())
                }
            };
            read.unwrap_or_else(|error| panic!("{error}\n{block}"));
        }
        assert!(configs >= least, "{name}: {configs}");
    }
}
