//! The config file: one YAML document, composed of the options of each module. Unknown keys and
//! invalid values are refused with line and column.

mod behaviours;
mod effective;
mod mqtt;
mod remote;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use crate::clock::{Span, Zone};
use crate::link::{self, Target};
use crate::pilot::Settings;
use crate::robot::Streams;
use crate::safety::PowerMeaning;
use crate::script::{self, Calibration};
use crate::sim::{PowerReading, World};
use crate::timetable::{Quiet, Rule, Timetable};
use crate::vision::{Camera, Colour};
use crate::{files, http, journal, notify, safety, yaml};

pub use self::behaviours::{Entry, Start};
pub use self::effective::{Effective, PASSWORD_PIPE_VARIABLE, PASSWORD_VARIABLE, Setting};
pub use self::mqtt::Mqtt;
pub use self::remote::{Remote, ServiceUrl};

const DATA_FOLDER: &str = "spykee-data";

/// The contents of a config file; everything is optional.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The robot's address, `HOST` or `HOST:PORT`.
    #[schemars(with = "Option<String>")]
    pub robot: Option<Target>,
    /// User name for the login.
    pub user: Option<String>,
    /// A file with the password in its first line.
    pub password_file: Option<PathBuf>,
    /// The behaviours to run if the command line names none.
    #[serde(deserialize_with = "behaviours::entries", skip_serializing)]
    pub behaviours: Vec<Entry>,
    /// The timetable by which `spykee serve` starts behaviours.
    pub schedule: Vec<Rule>,
    /// The time zone, such as `Europe/Rome` [default: the computer's].
    #[schemars(with = "Option<String>")]
    pub time_zone: Option<Zone>,
    /// Hours such as `22:00-07:00` in which scripts may use neither sounds nor the headlight.
    #[schemars(with = "Option<String>")]
    pub quiet: Option<Quiet>,
    /// Whether the alarm is silent too in these hours.
    pub quiet_alarm: bool,
    /// A scheduled start missed by less than this is made up for [default: 10m].
    pub catch_up: Span,
    /// What `spykee serve` does while no behaviour runs, and the user that runs it.
    pub service: Service,
    /// The limits of the safety rules.
    pub watchdog: safety::Limits,
    /// When the robot's streams are on; `off` forbids them.
    pub streams: Streams,
    /// The resource limits of a script.
    pub limits: script::Limits,
    /// The conversion of track power to speed.
    pub calibration: Calibration,
    /// Where the camera is on the robot, and its lens.
    #[serde(deserialize_with = "camera")]
    #[schemars(with = "CameraKeys")]
    pub camera: Camera,
    /// Colours by name, in addition to the built-in ones: ranges of `h`, `s` and `v` (degrees,
    /// percent), or of `l`, `a` and `b`.
    #[schemars(with = "BTreeMap<String, BTreeMap<String, [f64; 2]>>")]
    pub colours: BTreeMap<String, Colour>,
    /// The data folder, with a folder for each behaviour.
    pub data: Option<PathBuf>,
    /// The page in the browser and the JSON API.
    pub live: http::Options,
    /// The record of what happens.
    pub journal: journal::Options,
    /// Notifications to people, by webhooks, topics and commands.
    pub notify: notify::Options,
    /// The MQTT broker through which others see and command the robot.
    pub mqtt: Mqtt,
    /// A service on another computer that `spykee status`, `behaviour` and `robot` use.
    pub remote: Remote,
}

impl Default for Config {
    fn default() -> Config {
        Config {
            robot: None,
            user: None,
            password_file: None,
            behaviours: Vec::new(),
            schedule: Vec::new(),
            time_zone: None,
            quiet: None,
            quiet_alarm: true,
            catch_up: Span::minutes(10),
            service: Service::default(),
            watchdog: safety::Limits::default(),
            streams: Streams::default(),
            limits: script::Limits::default(),
            calibration: Calibration::default(),
            camera: Camera::default(),
            colours: BTreeMap::new(),
            data: None,
            journal: journal::Options::default(),
            notify: notify::Options::default(),
            live: http::Options::default(),
            mqtt: Mqtt::default(),
            remote: Remote::default(),
        }
    }
}

/// The camera as the config says it. What it leaves out is that of the robot's own camera.
#[derive(Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct CameraKeys {
    /// Height of the lens above the floor, metres.
    #[serde(default, deserialize_with = "range::lens_height")]
    height: Option<f64>,
    /// Degrees by which the camera looks up; negative down.
    #[serde(default, deserialize_with = "range::pitch")]
    pitch: Option<f64>,
    /// Degrees, positive when the horizon falls to the right in the picture.
    #[serde(default, deserialize_with = "range::roll")]
    roll: Option<f64>,
    /// Another lens: its focal lengths along columns and rows, in pixels of a picture of 320x240.
    focal: Option<[FocalLength; 2]>,
    /// Column and row of its optical axis in a picture of 320x240.
    centre: Option<[CentrePixel; 2]>,
    /// Its distortion: `[k1, k2]` or `[k1, k2, p1, p2]`.
    #[serde(default, deserialize_with = "distortion")]
    distortion: Option<Vec<f64>>,
    /// Another lens: its horizontal field of view without distortion, radians. Alone it means a
    /// lens without distortion.
    #[serde(default, deserialize_with = "range::hfov")]
    hfov: Option<f64>,
}

#[derive(Clone, Copy, Deserialize, schemars::JsonSchema)]
struct FocalLength(#[serde(deserialize_with = "range::focal")] f64);
#[derive(Clone, Copy, Deserialize, schemars::JsonSchema)]
struct CentrePixel(#[serde(deserialize_with = "range::centre")] f64);

mod range {
    crate::yaml::ranges! {
        lens_height = 0.05..=1.0, "metres";
        pitch = -60.0..=45.0, "degrees, up is positive";
        roll = -45.0..=45.0, "degrees, positive when the horizon falls to the right";
        focal = 50.0..=5000.0, "pixels of a picture of 320x240";
        centre = 0.0..=320.0, "pixels of a picture of 320x240";
        hfov = 0.1..=3.0, "radians";
        distortion = -2.0..=2.0, "0 is no distortion";
    }
}

fn distortion<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<f64>>, D::Error> {
    #[derive(Deserialize)]
    struct Factor(#[serde(deserialize_with = "range::distortion")] f64);
    let factors = <Vec<Factor>>::deserialize(from)?;
    match factors.len() {
        2 | 4 => Ok(Some(factors.into_iter().map(|factor| factor.0).collect())),
        count => Err(serde::de::Error::custom(format_args!(
            "{count} factors of distortion, expected k1, k2 or k1, k2, p1, p2"
        ))),
    }
}

/// Reads and checks the camera's parameters here, as the vision module does not know the config.
fn camera<'de, D: Deserializer<'de>>(from: D) -> Result<Camera, D::Error> {
    let keys = CameraKeys::deserialize(from)?;
    let mut camera = keys.hfov.map_or_else(Camera::default, Camera::pinhole);
    camera.height = keys.height.unwrap_or(camera.height);
    camera.pitch = keys.pitch.unwrap_or(camera.pitch);
    camera.roll = keys.roll.unwrap_or(camera.roll);
    if let Some(focal) = keys.focal {
        camera.focal = focal.map(|length| length.0);
    }
    if let Some(centre) = keys.centre {
        camera.centre = centre.map(|pixel| pixel.0);
    }
    if let Some(factors) = keys.distortion {
        camera.distortion = [0.0; 4];
        camera.distortion[..factors.len()].copy_from_slice(&factors);
    }
    if camera.is_one_to_one() {
        Ok(camera)
    } else {
        Err(serde::de::Error::custom(
            "this distortion folds the picture: expected numbers closer to 0, or a narrower view",
        ))
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("cannot read the config {path}: {source}")]
    Read {
        path: String,
        source: std::io::Error,
    },
    /// The config is not valid; line and column are in the reason.
    #[error("{path}: {reason}")]
    Invalid {
        /// Its path, or the environment variable.
        path: String,
        reason: String,
    },
}

impl Config {
    /// Reads a file. Paths in it are relative to its folder.
    pub fn load(path: &Path) -> Result<Config, ConfigError> {
        Config::parse_file(&Config::read(path)?, path)
    }

    pub fn data_folder(&self) -> &Path {
        self.data.as_deref().unwrap_or(Path::new(DATA_FOLDER))
    }

    /// The time zone: the config's, or else the computer's.
    pub fn zone(&self) -> Zone {
        self.time_zone.clone().unwrap_or_else(Zone::system)
    }

    pub fn timetable(&self) -> Timetable {
        Timetable {
            rules: self.schedule.clone(),
            zone: self.zone(),
            quiet: self.quiet,
            catch_up: self.catch_up,
        }
    }

    pub fn pilot(&self, simulated: bool, seed: u64) -> Settings {
        Settings {
            limits: self.watchdog.clone(),
            simulated,
            seed,
            link: link::Options::default(),
            waits: false,
            streams: self.streams,
        }
    }

    /// Enters what `spykee doctor --first` would find out of the robot in this world, where the config
    /// has the default; and its camera.
    pub fn with_robot_of(mut self, world: &World) -> Config {
        self.camera = world.camera.calibrated();
        let calibration = &mut self.calibration;
        if calibration.least_power == Calibration::default().least_power {
            calibration.least_power = world.tracks.least_power();
        }
        let power = &mut self.watchdog.power;
        if *power == PowerMeaning::Auto && world.battery.power == PowerReading::Voltage {
            *power = PowerMeaning::Voltage;
        }
        self
    }

    /// The options of a script with this name; `chunk` is its file as messages show it.
    pub fn script(
        &self,
        name: impl Into<String>,
        chunk: impl Into<String>,
        seed: u64,
    ) -> script::Options {
        script::Options {
            seed,
            limits: self.limits.clone(),
            calibration: self.calibration,
            camera: self.camera,
            colours: self.colours.clone(),
            streams: self.streams,
            detections: self.live.listen.is_some(),
            time_zone: self.zone().name().to_owned(),
            ..script::Options::new(name, chunk)
        }
    }

    fn read(path: &Path) -> Result<String, ConfigError> {
        let name = path.display().to_string();
        let read = |source| ConfigError::Read {
            path: name.clone(),
            source,
        };
        files::read_text(path, yaml::MAX_LEN).map_err(|error| read(error.into()))
    }

    fn parse_file(text: &str, path: &Path) -> Result<Config, ConfigError> {
        let mut config = Config::parse(text, &path.display().to_string())?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let paths = config.behaviours.iter_mut().map(|entry| &mut entry.file);
        let rescue = match &mut config.watchdog.rescue {
            safety::Rescue::File(path) => Some(path),
            safety::Rescue::Builtin | safety::Rescue::Off => None,
        };
        let targets = config.notify.targets.values_mut();
        let tokens = targets.filter_map(|target| target.token_file.as_mut());
        for path in paths
            .chain(rescue)
            .chain(tokens)
            .chain(&mut config.mqtt.password_file)
            .chain(&mut config.remote.token_file)
            .chain(&mut config.mqtt.ca_file)
            .chain(&mut config.data)
            .chain(&mut config.password_file)
        {
            *path = folder.join(&path);
        }
        Ok(config)
    }

    /// Parses a text; `name` is its name in errors.
    pub fn parse(text: &str, name: &str) -> Result<Config, ConfigError> {
        let invalid = |reason: String| ConfigError::Invalid {
            path: name.to_owned(),
            reason,
        };
        if text
            .lines()
            .all(|line| line.trim().is_empty() || line.trim().starts_with('#'))
        {
            return Ok(Config::default());
        }
        yaml::examine(text).map_err(|error| invalid(error.to_string()))?;
        let config: Config =
            serde_yaml::from_str(text).map_err(|error| invalid(explain(&error)))?;
        config
            .watchdog
            .check()
            .map_err(|error| invalid(error.to_string()))?;
        let is_empty = |rule: &&Rule| rule.lasts.is_some_and(|lasts| lasts.get().is_zero());
        if let Some(Rule { run, .. }) = config.schedule.iter().find(is_empty) {
            return Err(invalid(format!(
                "schedule: `for` of `{run}` must be above zero"
            )));
        }
        config.notify.check().map_err(invalid)?;
        config.mqtt.check().map_err(invalid)?;
        if let (Some(target), None) = (config.notify.needs_broker(), &config.mqtt.host) {
            return Err(invalid(format!(
                "notify.targets.{target}: a topic needs a broker, but no `mqtt: {{ host: ... }}` is \
                 set"
            )));
        }
        Ok(config)
    }
}

/// An error of the parser in plain words. It leaves out the place at the very beginning of a text.
fn explain(error: &serde_yaml::Error) -> String {
    let mut message = error.to_string();
    if error.location().is_some() && !message.contains(" at line ") {
        message += " at line 1 column 1";
    }
    yaml::in_plain_words(&message)
}

/// What a service does while no behaviour runs, and the user that runs it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Service {
    /// What happens to the link while no behaviour runs: `keep`, or `release`, so that others can
    /// log in.
    pub idle: Idle,
    /// The time without a behaviour after which the robot is idle [default: 1m].
    pub idle_after: Span,
    /// Whether an idle robot that is off its station is sent there.
    pub dock: bool,
    /// The user that a service started as root continues as.
    pub user: Option<String>,
}

impl Default for Service {
    fn default() -> Service {
        Service {
            idle: Idle::default(),
            idle_after: Span::minutes(1),
            dock: true,
            user: None,
        }
    }
}

/// What happens to the link while no behaviour runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Idle {
    /// The service stays connected and monitors the battery.
    #[default]
    Keep,
    /// The service disconnects from a robot on its station, so that another program can log in.
    Release,
}

/// The schema of a whole config file (JSON Schema 2020-12).
pub fn schema() -> Value {
    schemars::schema_for!(Config).to_value()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Priority;
    use proptest::prelude::*;

    fn error(text: &str) -> String {
        Config::parse(text, "spykee.yaml").unwrap_err().to_string()
    }

    #[test]
    fn an_empty_file_is_all_defaults() {
        let config = Config::parse("# nothing yet\n", "spykee.yaml").unwrap();
        assert_eq!(config.watchdog, safety::Limits::default());
        assert!(config.robot.is_none() && config.behaviours.is_empty());
    }

    #[test]
    fn a_simulated_robot_is_known_where_the_config_has_the_default() {
        let world = |preset: &str| {
            let text = format!(
                "preset: {preset}\nroom: {{width: 4, depth: 4}}\n\
                 station: {{at: [0, 2], heading_degrees: 0}}\n"
            );
            World::from_yaml(&text, "w.yaml").unwrap()
        };
        let genuine = Config::default().with_robot_of(&world("genuine"));
        assert_eq!(genuine.watchdog.power, PowerMeaning::Voltage);
        assert_eq!(genuine.calibration.least_power, 20.0);
        assert!(genuine.camera.pitch > 0.0);
        let exact = Config::default().with_robot_of(&world("exact"));
        assert_eq!(exact.watchdog.power, PowerMeaning::Auto);
        assert_eq!(exact.calibration.least_power, 5.6);
        let text = "watchdog: { power: percent }\ncalibration: { least_power: 30 }\n";
        let said = Config::parse(text, "spykee.yaml").unwrap();
        let kept = said.with_robot_of(&world("genuine"));
        assert_eq!(kept.watchdog.power, PowerMeaning::Percent);
        assert_eq!(kept.calibration.least_power, 30.0);
    }

    #[test]
    fn all_sections_are_read() {
        let text = "robot: 172.17.6.1\nbehaviours:\n  - file: patrol.lua\n    priority: 3\n\
                watchdog: { low: 25, host_silence: 0.5 }\n";
        let config = Config::parse(text, "spykee.yaml").unwrap();
        assert_eq!(config.robot.unwrap().to_string(), "172.17.6.1:9000");
        assert_eq!(config.behaviours[0].priority, Priority(3));
        assert_eq!(config.watchdog.low.get(), 25);
    }

    #[test]
    fn an_unknown_key_in_the_first_line_is_refused_with_its_place() {
        let text = error("colors: {}\n");
        assert!(
            text.contains("line 1 column 1; did you mean 'colours'?"),
            "{text}"
        );
    }

    #[test]
    fn errors_name_no_types_of_this_program() {
        for (yaml, told) in [
            ("mqtt: broker.local\n", "expected keys with values"),
            ("live: { listen: 7788 }\n", "expected IP:PORT"),
            (
                "journal: { keep_days: many }\n",
                "expected a whole number of days",
            ),
            ("schedule:\n  - at: */5 * * * *\n", "in quotes"),
            ("robot: a\n\tuser: b\n", "not with tabs"),
            (
                "mqtt:\n  host: broker:1883\n",
                "mqtt.host: `broker:1883` is not a host: write `host: broker` and `port: 1883` at",
            ),
            (
                "remote:\n  url: 10.0.0.7:7788\n",
                "remote.url: expected http://HOST:PORT or https://HOST",
            ),
            ("live:\n\tlisten: b\n", "not with tabs"),
        ] {
            let text = error(yaml);
            assert!(text.contains(told), "{yaml}: {text}");
        }
    }

    #[test]
    fn invalid_numbers_are_refused_with_their_place() {
        for wrong in [
            "calibration:\n  full_speed: 0\n",
            "calibration:\n  track_width: .nan\n",
            "calibration:\n  least_power: 60\n",
            "camera:\n  hfov: 0\n",
            "camera:\n  distortion: [-3, 0]\n",
            "camera:\n  distortion: [0.1, 0, 0]\n",
            "camera:\n  height: 0\n",
            "camera:\n  pitch: -90\n",
            "camera:\n  roll: .nan\n",
            "camera:\n  focal: [381, 0]\n",
            "limits:\n  memory_bytes: 0\n",
            "limits:\n  callback_budget_ms: 0.5\n",
            "limits:\n  noise_dbfs: .nan\n",
            "schedule:\n- { run: patrol, at: \"0 25 * * *\" }\n",
            "service:\n  idle_after: soon\n",
        ] {
            let text = error(wrong);
            assert!(
                text.contains("line 2 column") && text.contains("expected"),
                "{text}"
            );
        }
        let good = "limits: { memory_bytes: 16777216 }\ncamera: { hfov: 1 }\n";
        let config = Config::parse(good, "spykee.yaml").unwrap();
        assert_eq!(config.limits.memory_bytes, 16 << 20);
    }

    #[test]
    fn a_pose_alone_keeps_the_robots_lens_and_a_field_of_view_alone_has_no_distortion() {
        let camera = |keys: &str| {
            let text = format!("camera: {keys}\n");
            Config::parse(&text, "spykee.yaml").unwrap().camera
        };
        let usual = Camera::default();
        let posed = Camera {
            height: 0.27,
            pitch: -9.5,
            roll: 2.0,
            ..usual
        };
        assert_eq!(camera("{ height: 0.27, pitch: -9.5, roll: 2 }"), posed);
        assert_eq!(camera("{ hfov: 1 }"), Camera::pinhole(1.0));
        let other = Camera {
            focal: [400.0, 401.0],
            centre: [160.0, 118.0],
            distortion: [-0.2, 0.05, 0.001, 0.0],
            ..usual
        };
        let keys = "{ focal: [400, 401], centre: [160, 118], distortion: [-0.2, 0.05, 0.001, 0] }";
        assert_eq!(camera(keys), other);
        assert_eq!(
            camera("{ distortion: [-0.2, 0.05] }").distortion,
            [-0.2, 0.05, 0.0, 0.0]
        );
    }

    #[test]
    fn a_topic_without_a_broker_is_refused() {
        let target = "notify: { targets: { house: { topic: a } } }\n";
        assert!(error(target).contains("notify.targets.house"));
        let named = format!("{target}mqtt: {{ host: broker.local }}\n");
        Config::parse(&named, "spykee.yaml").unwrap();
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[ -~\n]{0,200}") {
            let _ = Config::parse(&text, "spykee.yaml");
        }
    }

    const EXAMPLE: &str = include_str!("../behaviours/spykee.example.yaml");

    fn example() -> serde_yaml::Value {
        serde_yaml::from_str(EXAMPLE).unwrap()
    }

    #[test]
    fn the_example_names_every_setting() {
        let text = example();
        for setting in Effective::default().settings() {
            let key = setting.key;
            let found = key.split('.').try_fold(&text, |tree, name| tree.get(name));
            assert!(found.is_some(), "{key} is not in the example");
        }
        let entry = &text["behaviours"][1];
        let schema = schema();
        let keys = schema["$defs"]["Behaviour"]["properties"]
            .as_object()
            .unwrap();
        for key in keys.keys().filter(|key| *key != "params") {
            assert!(entry.get(key).is_some(), "{key} is not in the example");
        }
    }

    #[test]
    fn the_example_is_valid_and_has_the_defaults() {
        let config = Config::parse(EXAMPLE, "example").unwrap();
        let usual = Config::default();
        assert_eq!(config.watchdog, usual.watchdog);
        assert_eq!(config.streams, usual.streams);
        assert_eq!(config.limits, usual.limits);
        assert_eq!(config.calibration, usual.calibration);
        assert_eq!(config.journal, usual.journal);
        assert_eq!(config.camera, usual.camera);
        assert_eq!((config.behaviours.len(), config.colours.len()), (2, 2));
    }

    /// Whether the schema knows every key of a value, as far as it closes its objects.
    fn knows(root: &Value, schema: &Value, value: &serde_yaml::Value, at: &str) {
        let schema = match schema["$ref"].as_str() {
            Some(path) => root.pointer(path.trim_start_matches('#')).unwrap(),
            None => schema,
        };
        let Some(map) = value.as_mapping() else {
            let items = value.as_sequence().into_iter().flatten();
            return items.for_each(|item| knows(root, &schema["items"], item, at));
        };
        for (key, value) in map {
            let key = key.as_str().unwrap();
            let inner = match schema["properties"].get(key) {
                Some(inner) => inner,
                None => &schema["additionalProperties"],
            };
            assert!(inner.is_object() || inner == true, "{at}.{key}: {schema}");
            knows(root, inner, value, &format!("{at}.{key}"));
        }
    }

    #[test]
    fn the_schema_has_all_keys_of_the_example_and_refuses_others() {
        let schema = schema();
        knows(&schema, &schema, &example(), "");
        for closed in [
            "/additionalProperties",
            "/$defs/Limits/additionalProperties",
        ] {
            assert_eq!(schema.pointer(closed), Some(&false.into()), "{closed}");
        }
        let lasts = schema.pointer("/$defs/Rule/properties/for/type").unwrap();
        assert_eq!(lasts, &serde_json::json!(["string", "number", "null"]));
        let low = schema.pointer("/$defs/Limits/properties/low").unwrap();
        assert_eq!(
            (&low["maximum"], low["type"].as_str()),
            (&100.into(), Some("integer"))
        );
    }
}
