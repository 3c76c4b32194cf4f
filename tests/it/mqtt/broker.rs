//! A private broker, and a client that records its messages.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rumqttc::{AsyncClient, Event, MqttOptions, Packet, QoS};
use rustix::process::Signal;
use serde_json::Value;

use crate::rig::WAIT_LIMIT;

/// A private mosquitto; ends with the test.
pub struct Broker {
    child: Child,
    pub port: u16,
    folder: tempfile::TempDir,
}

impl Drop for Broker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The path of mosquitto. Debian installs it in /usr/sbin, which not every search path contains.
fn mosquitto() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::env::split_paths(&path).chain([PathBuf::from("/usr/sbin")]);
    let found = folders
        .map(|one| one.join("mosquitto"))
        .find(|one| one.is_file());
    if found.is_none() {
        eprintln!("skipped: mosquitto is not installed (scripts/check installs it)");
    }
    found
}

impl Broker {
    /// Starts a broker at which every client has all rights.
    pub fn start() -> Option<Broker> {
        Broker::start_with("allow_anonymous true\n", &[])
    }

    /// Starts a broker with these lines in its config, where `@` stands for its folder, and with
    /// these users and passwords.
    pub fn start_with(lines: &str, users: &[(&str, &str)]) -> Option<Broker> {
        let executable = mosquitto()?;
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().display().to_string();
        std::fs::write(folder.path().join("users"), "").unwrap();
        for (user, password) in users {
            let mut add = Process::new("mosquitto_passwd");
            add.arg("-b")
                .arg(folder.path().join("users"))
                .args([user, password]);
            assert!(add.status().unwrap().success());
        }
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = free.local_addr().unwrap().port();
        drop(free);
        // If root starts it, it would switch to another user, who cannot write here.
        let config = format!(
            "listener {port} 127.0.0.1\npersistence true\n\
             persistence_location {place}/\nuser root\n{}",
            lines.replace('@', &place)
        );
        std::fs::write(folder.path().join("mosquitto.conf"), config).unwrap();
        let child = Broker::spawn(&executable, folder.path());
        Some(Broker {
            child,
            port,
            folder,
        })
    }

    fn spawn(executable: &Path, folder: &Path) -> Child {
        let mut process = Process::new(executable);
        process.arg("-c").arg(folder.join("mosquitto.conf"));
        process.stdout(Stdio::null()).stderr(Stdio::null());
        process.spawn().unwrap()
    }

    /// Stops it in order and starts it again with its saved messages.
    pub fn restart(&mut self) {
        self.stop();
        self.begin();
    }

    pub fn stop(&mut self) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, Signal::TERM).unwrap();
        self.child.wait().unwrap();
    }

    /// Starts it again at the same address.
    pub fn begin(&mut self) {
        self.child = Broker::spawn(&mosquitto().unwrap(), self.folder.path());
    }

    /// Deletes its saved messages.
    pub fn forget(&self) {
        std::fs::remove_file(self.folder.path().join("mosquitto.db")).unwrap();
    }

    /// Writes a file into its folder.
    pub fn file(&self, name: &str, text: &str) {
        std::fs::write(self.folder.path().join(name), text).unwrap();
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn config(&self) -> String {
        format!("mqtt: {{ host: 127.0.0.1, port: {} }}\n", self.port)
    }
}

/// A topic and the payload published there.
type Published = (String, Vec<u8>);

/// A client that records all messages at the broker.
pub struct Subscriber {
    client: AsyncClient,
    received: Arc<Mutex<Vec<Published>>>,
    task: tokio::task::JoinHandle<()>,
}

impl Drop for Subscriber {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Subscriber {
    pub async fn connect(broker: &Broker) -> Subscriber {
        Subscriber::connect_as(broker, None).await
    }

    /// Connects as this user, with this password.
    pub async fn connect_as(broker: &Broker, user: Option<(&str, &str)>) -> Subscriber {
        let id = format!("subscriber-{}", rand::random::<u32>());
        let mut options = MqttOptions::new(id, "127.0.0.1", broker.port);
        options.set_max_packet_size(1 << 20, 1 << 20);
        if let Some((user, password)) = user {
            options.set_credentials(user, password);
        }
        let (client, mut events) = AsyncClient::new(options, 100);
        let received = Arc::new(Mutex::new(Vec::new()));
        let kept = received.clone();
        let subscriber = client.clone();
        let task = tokio::spawn(async move {
            loop {
                match events.poll().await {
                    Ok(Event::Incoming(Packet::ConnAck(_))) => {
                        subscriber.try_subscribe("#", QoS::AtLeastOnce).unwrap();
                    }
                    Ok(Event::Incoming(Packet::Publish(one))) => {
                        let mut received: std::sync::MutexGuard<'_, Vec<(String, Vec<u8>)>> =
                            kept.lock().unwrap();
                        received.push((one.topic, one.payload.to_vec()));
                    }
                    Ok(_) => {}
                    Err(_) => tokio::time::sleep(Duration::from_millis(50)).await,
                }
            }
        });
        Subscriber {
            client,
            received,
            task,
        }
    }

    pub async fn publish(&self, topic: &str, payload: &str, retain: bool) {
        let published = self
            .client
            .publish(topic, QoS::AtLeastOnce, retain, payload);
        published.await.unwrap();
    }

    /// Waits until the client receives messages again, after the broker was away.
    pub async fn wait_until_connected(&self) {
        let until = std::time::Instant::now() + WAIT_LIMIT;
        let from = self.len();
        while !self.received.lock().unwrap()[from..]
            .iter()
            .any(|(topic, _)| topic == "subscriber/again")
        {
            assert!(std::time::Instant::now() < until, "the broker is not back");
            self.publish("subscriber/again", "", false).await;
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    pub fn len(&self) -> usize {
        self.received.lock().unwrap().len()
    }

    /// Waits for a matching message, from an index on, and returns its payload.
    pub async fn wait_for(
        &self,
        from: usize,
        topic: &str,
        wanted: impl Fn(&[u8]) -> bool,
    ) -> Vec<u8> {
        let until = std::time::Instant::now() + WAIT_LIMIT;
        loop {
            let received = self.received.lock().unwrap()[from..].to_vec();
            let found = received
                .iter()
                .find(|(of, payload)| of == topic && wanted(payload));
            if let Some((_, payload)) = found {
                return payload.clone();
            }
            let topics: Vec<_> = received
                .iter()
                .map(|(topic, payload)| (topic, String::from_utf8_lossy(payload)))
                .collect();
            assert!(
                std::time::Instant::now() < until,
                "not {topic}, but {topics:?}"
            );
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// The index of the first such message among all recorded ones.
    pub fn index_of(&self, topic: &str, word: &str) -> Option<usize> {
        let received = self.received.lock().unwrap();
        let mut received = received.iter();
        received.position(|(of, payload)| of == topic && payload == word.as_bytes())
    }

    /// Whether a message arrived at a topic below this one.
    pub fn has_message_below(&self, below: &str) -> bool {
        let received = self.received.lock().unwrap();
        received.iter().any(|(topic, _)| topic.starts_with(below))
    }

    pub async fn wait_for_text(&self, from: usize, topic: &str, word: &str) {
        self.wait_for(from, topic, |payload| payload == word.as_bytes())
            .await;
    }

    pub async fn wait_for_state(
        &self,
        from: usize,
        robot: &str,
        wanted: impl Fn(&Value) -> bool,
    ) -> Value {
        let read = |payload: &[u8]| serde_json::from_slice::<Value>(payload).unwrap();
        let topic = format!("spykee/{robot}/state");
        let state = self
            .wait_for(from, &topic, |payload| wanted(&read(payload)))
            .await;
        read(&state)
    }
}
