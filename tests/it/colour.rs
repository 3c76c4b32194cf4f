//! `spykee colour find` and `spykee colour learn` from the command line, on pictures from the simulator.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;
use spykee::config::Config;
use spykee::sim::{Firmware, Pose, Robot, World};
use spykee::vision::{BlobOptions, Camera, Colour, FrameAnalyser, Roi};
use spykee::wire::{Command, Report, Stream};

use crate::rig::{Ended, assert_contains, run_in};

/// The robot has a red ball in front to the left, a blue post in front to the right, and a green
/// ball behind it.
const ROOM: &str = "
name: test
room: { width: 6, depth: 6 }
balls: [{ at: [4, 3.25], colour: red }, { at: [1.6, 3], colour: green }]
posts: [{ at: [4.2, 2.5], colour: blue }]
station: { at: [0, 1], heading_degrees: 0 }
start: { at: [2.9, 3], heading_degrees: 0 }
";
const START: (f64, f64) = (2.9, 3.0);
const BACK: f64 = std::f64::consts::PI;
/// A region inside the red ball, as the robot sees it from its start.
const IN_BALL: &str = "75,135,30,25";
const IN_BALL_ROI: Roi = Roi {
    x: 75,
    y: 135,
    w: 30,
    h: 25,
};
/// A camera with a wide, sharp view.
const WIDE: &str = "camera: { height: 0.2, hfov_degrees: 60, quality: 75, subsampling: '4:2:2' }\n";
/// A region of bare wall above the ball.
const ON_WALL: &str = "150,20,40,40";

/// The camera's picture at the start, turned by `heading`, in a room with this brightness.
fn shot(heading: f64, light: f64) -> Vec<u8> {
    let world = format!("{ROOM}light: {light}\n{WIDE}");
    let world = World::from_yaml(&world, "test world").unwrap();
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    robot.place(Pose::new(START.0, START.1, heading));
    let stream = Stream::Video;
    robot.execute(&Command::Stream { stream, on: true });
    robot.step(Duration::from_millis(20));
    let frame = |report| match report {
        Report::Video(jpeg) => Some(jpeg.to_vec()),
        _ => None,
    };
    robot.take_reports().into_iter().find_map(frame).unwrap()
}

/// A folder with `ahead.jpg` and `back.jpg`, in which the command runs.
struct Workspace(tempfile::TempDir);

impl Workspace {
    fn new() -> Workspace {
        let workspace = Workspace(tempfile::tempdir().unwrap());
        workspace.put("ahead.jpg", &shot(0.0, 0.9));
        workspace.put("back.jpg", &shot(BACK, 0.9));
        workspace
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// Runs `spykee` with a command line split at spaces; returns exit code, stdout and stderr.
    fn spykee(&self, line: &str) -> (Option<i32>, String, String) {
        let args: Vec<&str> = line.split(' ').collect();
        let Ended { code, out, err } = run_in(self.0.path(), &args);
        (code, out, err)
    }

    /// The output of a command that succeeds.
    fn done(&self, line: &str) -> String {
        let (code, out, error) = self.spykee(line);
        assert_eq!((code, error.as_str()), (Some(0), ""), "{line}");
        out
    }

    /// The error message of a command that is refused; it must write nothing else.
    fn refused(&self, line: &str) -> String {
        let (code, out, error) = self.spykee(line);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{line}: {error}");
        assert!(error.starts_with("error: "), "{error}");
        error
    }

    fn json(&self, line: &str) -> Value {
        serde_json::from_str(&self.done(line)).unwrap()
    }
}

#[test]
fn the_table_has_a_row_for_each_blob_and_for_each_picture_without() {
    let workspace = Workspace::new();
    let table = workspace.done("colour find ahead.jpg back.jpg --colour red --colour blue");
    let rows: Vec<Vec<&str>> = table
        .lines()
        .map(|row| row.split_whitespace().collect())
        .collect();
    assert_eq!(rows[0][..4], ["FILE", "#", "COLOUR", "PIXELS"]);
    assert_eq!(rows[1][..3], ["ahead.jpg", "1", "blue"]);
    assert_eq!(rows[2][..3], ["ahead.jpg", "2", "red"]);
    assert_eq!(rows[3], ["back.jpg", "-", "none"]);
    assert_eq!(rows.len(), 4);
    let at = |row: &str, word: &str| row.find(word).map(|at| at + word.len());
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(at(lines[0], "PIXELS"), at(lines[1], rows[1][3]), "{table}");
    assert_eq!(at(lines[0], "PIXELS"), at(lines[2], rows[2][3]), "{table}");
}

#[test]
fn json_has_the_same_fields_and_values_as_scripts() {
    let workspace = Workspace::new();
    let found = workspace.json("colour find ahead.jpg back.jpg --colour red,green --json");
    assert_eq!(found[0]["file"], "ahead.jpg");
    assert_eq!(
        found[0]["size"],
        serde_json::json!({ "width": 320, "height": 240 })
    );
    let mut analyser = FrameAnalyser::new(Camera::default());
    let colours = ["red", "green"].map(|name| Colour::named(name).unwrap());
    for (key, (picture, name)) in [("ahead.jpg", "red"), ("back.jpg", "green")]
        .iter()
        .enumerate()
    {
        let jpeg = std::fs::read(workspace.path(picture)).unwrap();
        let seen = analyser.find_blobs(key as u64, &jpeg, &colours, &BlobOptions::default());
        let mut expected = serde_json::json!(seen.unwrap());
        expected[0]["colour"] = (*name).into();
        // The last bit of a number may change when it is parsed.
        let expected: Value = serde_json::from_str(&expected.to_string()).unwrap();
        assert_eq!(found[key]["blobs"], expected);
    }
    let fields = "x y w h cx cy pixels area density rotation elongation roundness perimeter code \
                  count colour bearing edge";
    for field in fields.split_whitespace() {
        assert!(!found[0]["blobs"][0][field].is_null(), "{field}");
    }
}

#[test]
fn blobs_that_are_too_small_or_outside_the_region_are_omitted() {
    let workspace = Workspace::new();
    let count = |options: &str| {
        let found = workspace.json(&format!(
            "colour find ahead.jpg --colour red,blue --json {options}"
        ));
        found[0]["blobs"].as_array().unwrap().len()
    };
    assert_eq!(count("--roi 0,0,160,240"), 1);
    assert_eq!(count("--roi 160,0,160,240"), 1);
    assert_eq!(count("--min-pixels 3000"), 1);
    assert_eq!(count("--min-pixels 30000"), 0);
    let error = workspace.refused("colour find ahead.jpg --colour red --roi 400,0,10,10");
    assert_contains(&error, &["ahead.jpg", "320x240"]);
}

#[test]
fn no_more_blobs_than_requested_are_shown_and_a_note_says_so() {
    let workspace = Workspace::new();
    let (code, table, note) =
        workspace.spykee("colour find ahead.jpg --colour red,blue --max-blobs 1");
    assert_eq!((code, table.lines().count()), (Some(0), 2), "{table}");
    assert_contains(&note, &["ahead.jpg", "--max-blobs"]);
}

#[test]
fn the_config_provides_colours_and_the_field_of_view() {
    let workspace = Workspace::new();
    workspace.put(
        "spykee.yaml",
        b"camera: { hfov: 2.0 }\ncolours: { ball: { h: [340, 15], s: [50, 100] } }\n",
    );
    let wide = workspace.json("colour find ahead.jpg --colour ball --config spykee.yaml --json");
    // A spykee.yaml in the folder is used without being named.
    let found = workspace.json("colour find ahead.jpg --colour ball --json");
    assert_eq!(wide, found);
    workspace.put("spykee.yaml", b"");
    let usual = workspace.json("colour find ahead.jpg --colour red --json");
    let bearing = |found: &Value| found[0]["blobs"][0]["bearing"].as_f64().unwrap();
    assert_eq!(wide[0]["blobs"][0]["colour"], "ball");
    assert!(bearing(&wide) > 1.5 * bearing(&usual), "{wide} {usual}");
}

#[test]
fn an_unknown_colour_is_refused_with_the_nearest_and_all_known_ones() {
    let workspace = Workspace::new();
    workspace.put("spykee.yaml", b"colours: { sock: { h: [270, 310] } }\n");
    let error = workspace.refused("colour find ahead.jpg --colour gren");
    assert_contains(&error, &["'gren'", "'green'"]);
    assert!(
        Colour::NAMES.iter().all(|name| error.contains(name)),
        "{error}"
    );
    let error = workspace.refused("colour find ahead.jpg --colour sok --config spykee.yaml");
    assert_contains(&error, &["did you mean 'sock'"]);
}

#[test]
fn an_unreadable_picture_is_named_with_its_reason_and_the_others_are_processed() {
    let workspace = Workspace::new();
    let whole = std::fs::read(workspace.path("ahead.jpg")).unwrap();
    workspace.put("half.jpg", &whole[..whole.len() / 2]);
    workspace.put("text.jpg", b"no picture");
    let (code, out, error) =
        workspace.spykee("colour find half.jpg text.jpg none.jpg . ahead.jpg --colour red --json");
    assert_eq!(code, Some(2));
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found.as_array().unwrap().len(), 1);
    assert_eq!(found[0]["file"], "ahead.jpg");
    let reasons = [
        ("half.jpg", "cut short"),
        ("text.jpg", "not a JPEG"),
        ("none.jpg", "No such file"),
        (" .: ", "folder"),
    ];
    for (file, reason) in reasons {
        let said = |line: &str| line.contains(file) && line.contains(reason);
        assert!(error.lines().any(said), "{file}: {error}");
    }
    let (_, out, _) = workspace.spykee("colour find text.jpg --colour red --json");
    assert_eq!(out, "[]\n");
}

fn png(path: &Path) -> image::RgbImage {
    image::open(path).unwrap().to_rgb8()
}

#[test]
fn a_marked_copy_shows_box_and_text_enlarged_and_the_rest_unchanged() {
    let workspace = Workspace::new();
    let found = workspace.json("colour find ahead.jpg --colour red --json --annotate out.png");
    let blob = |field: &str| found[0]["blobs"][0][field].as_u64().unwrap() as u32;
    let marked = png(&workspace.path("out.png"));
    let plain = image::open(workspace.path("ahead.jpg")).unwrap().to_rgb8();
    assert_eq!(marked.dimensions(), (960, 720));
    let changed = |x: u32, y: u32| {
        let pairs = marked
            .get_pixel(x, y)
            .0
            .into_iter()
            .zip(plain.get_pixel(x / 3, y / 3).0);
        pairs.map(|(one, other)| one.abs_diff(other)).max().unwrap() > 12
    };
    let left = 3 * blob("x");
    let top = 3 * blob("y");
    let right = left + 3 * blob("w");
    let bottom = top + 3 * blob("h");
    for step in 0..10 {
        let x = left + step * (right - left) / 10;
        let y = top + step * (bottom - top) / 10;
        assert!(changed(x, top - 2) && changed(x, bottom + 1), "row {x}");
        assert!(changed(left - 2, y) && changed(right + 1, y), "column {y}");
    }
    assert!(changed(left, top - 10), "no text above");
    let beside = (0..100)
        .filter(|step| changed(right + 20 + step, 400))
        .count();
    assert_eq!(beside, 0, "drawn where nothing was seen");
}

#[test]
fn the_ignored_part_is_dark_in_the_marked_copy() {
    let workspace = Workspace::new();
    let line = "colour find ahead.jpg --colour red --roi 0,0,160,240 --annotate";
    workspace.done(&format!("{line} part.png"));
    let light = |image: &image::RgbImage, x| u32::from(image.get_pixel(x, 60).0[1]);
    let part = png(&workspace.path("part.png"));
    assert!(light(&part, 400) > 2 * light(&part, 500), "{part:?}");
}

#[test]
fn several_marked_copies_go_into_a_folder_and_a_single_output_file_is_refused() {
    let workspace = Workspace::new();
    std::fs::create_dir(workspace.path("other")).unwrap();
    workspace.put("other/ahead.jpg", &shot(0.0, 0.5));
    workspace
        .done("colour find ahead.jpg back.jpg other/ahead.jpg --colour red --annotate marked/new");
    let folder = std::fs::read_dir(workspace.path("marked/new")).unwrap();
    let mut names: Vec<_> = folder.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(
        names,
        ["ahead-2-blobs.png", "ahead-blobs.png", "back-blobs.png"]
    );
    let error = workspace.refused("colour find ahead.jpg back.jpg --colour red --annotate out.png");
    assert_contains(&error, &["out.png", "folder"]);
    let error = workspace.refused("colour find ahead.jpg --colour red --annotate ahead.jpg");
    assert_contains(&error, &[".png"]);
    assert!(!workspace.path("out.png").exists());
    let help = workspace.done("colour find --help");
    assert_contains(&help, &["for several pictures a folder"]);
}

#[test]
fn a_learned_colour_pasted_into_a_config_finds_the_object() {
    let workspace = Workspace::new();
    let yaml = workspace.done(&format!(
        "colour learn ahead.jpg --roi {IN_BALL} --name ball"
    ));
    let config = Config::parse(&yaml, "learned").unwrap();
    assert!(config.colours.contains_key("ball"), "{yaml}");
    assert_contains(&yaml, &["very good", "ahead.jpg"]);
    workspace.put("spykee.yaml", yaml.as_bytes());
    let found = workspace.json("colour find ahead.jpg --colour ball --config spykee.yaml --json");
    let blobs = found[0]["blobs"].as_array().unwrap();
    assert_eq!(blobs.len(), 1, "{found}");
    let usual = workspace.json("colour find ahead.jpg --colour red --json");
    for centre in ["cx", "cy"] {
        let [one, other] = [&blobs[0], &usual[0]["blobs"][0]].map(|b| b[centre].as_f64().unwrap());
        assert!((one - other).abs() < 2.0, "{one} {other}");
    }
}

#[test]
fn learn_reports_what_the_colour_finds_inside_and_outside_the_region() {
    let workspace = Workspace::new();
    workspace.put("dim.jpg", &shot(0.0, 0.45));
    let learned = workspace.json(&format!(
        "colour learn ahead.jpg dim.jpg --roi {IN_BALL} --name ball --json"
    ));
    assert_eq!(learned["name"], "ball");
    let colour: Colour = serde_json::from_value(learned["colour"].clone()).unwrap();
    assert!(learned["quality"].as_f64().unwrap() > 0.9, "{learned}");
    let mut analyser = FrameAnalyser::new(Camera::default());
    for (key, name) in ["ahead.jpg", "dim.jpg"].into_iter().enumerate() {
        let proof = &learned["pictures"][key];
        let part = IN_BALL_ROI.w * IN_BALL_ROI.h;
        assert_eq!(proof["file"], name);
        assert_eq!(proof["inside"]["of"], part);
        assert_eq!(proof["outside"]["of"], 320 * 240 - part);
        assert_eq!(proof["largest_is_inside"], true);
        let jpeg = std::fs::read(workspace.path(name)).unwrap();
        let every = BlobOptions {
            area_threshold: 0,
            pixels_threshold: 0,
            ..BlobOptions::default()
        };
        let mut pixels = |roi| {
            let options = BlobOptions {
                roi,
                ..every.clone()
            };
            let blobs = analyser
                .find_blobs(key as u64, &jpeg, &[colour], &options)
                .unwrap();
            blobs.iter().map(|blob| blob.pixels).sum::<u32>()
        };
        let inside = pixels(Some(IN_BALL_ROI));
        let all = pixels(None);
        assert!(inside > part * 9 / 10, "{learned}");
        assert_eq!(proof["inside"]["pixels"], inside);
        assert_eq!(proof["outside"]["pixels"], all - inside);
    }
}

#[test]
fn grey_and_mixed_regions_are_refused_with_advice() {
    let workspace = Workspace::new();
    let grey = workspace.refused(&format!("colour learn ahead.jpg --roi {ON_WALL}"));
    assert_contains(&grey, &["too grey", "  help: "]);
    // The red ball ahead and the green one behind are in the same region.
    workspace.put("left.jpg", &shot(BACK + 0.24, 0.9));
    let mixed = "colour learn ahead.jpg left.jpg --roi 75,135,30,25";
    let error = workspace.refused(mixed);
    assert_contains(&error, &["too mixed", "  help: "]);
    let (code, out, _) = workspace.spykee(&format!("{mixed} --json"));
    let refused: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        (code, &refused["refused"]),
        (Some(2), &Value::from("too_mixed"))
    );
}

#[test]
fn a_colour_that_some_picture_does_not_contain_is_rated_poor() {
    let workspace = Workspace::new();
    let yaml = workspace.done(&format!("colour learn ahead.jpg back.jpg --roi {IN_BALL}"));
    let verdict = yaml.lines().find(|line| line.contains("Quality")).unwrap();
    assert!(verdict.contains("poor: not every picture"), "{yaml}");
}

#[test]
fn learning_continues_without_unusable_pictures() {
    let workspace = Workspace::new();
    workspace.put("text.jpg", b"no picture");
    let (code, yaml, error) =
        workspace.spykee(&format!("colour learn text.jpg ahead.jpg --roi {IN_BALL}"));
    assert_eq!(code, Some(2));
    assert!(
        Config::parse(&yaml, "learned").is_ok() && yaml.contains("thing:"),
        "{yaml}"
    );
    assert_contains(&error, &["text.jpg", "not a JPEG"]);
    let error = workspace.refused("colour learn ahead.jpg --roi 320,0,10,10");
    assert_contains(&error, &["outside ahead.jpg"]);
}

#[test]
fn missing_or_wrong_arguments_end_with_2() {
    let workspace = Workspace::new();
    for line in [
        "colour find --colour red",
        "colour find ahead.jpg",
        "colour find ahead.jpg --colour red --roi 1,2,3",
        "colour find ahead.jpg --colour red --min-pixels -1",
        "colour learn ahead.jpg",
        "colour learn --roi 1,2,3,4",
        "colour learn ahead.jpg --roi 1,2,0,4",
        "colour learn ahead.jpg --roi 1,2,3,4 --name a:b",
        "colour find ahead.jpg --colour red --config none.yaml",
    ] {
        let error = workspace.refused(line);
        assert!(!error.contains("internal error"), "{line}: {error}");
    }
}
