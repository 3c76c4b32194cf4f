//! Frames as behaviours receive them: damaged ones between good ones, and annotated copies for
//! people.

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use bytes::Bytes;
use rustix::process::Signal;
use spykee::sim::{Fault, Firmware, Handle, Options, World};
use spykee::vision::validate_markers;
use spykee::wire::Report;
use tokio::time::{Instant, timeout};

use crate::rig::{QUIET_WORLD, Rig, WAIT_LIMIT, assert_contains};

const GOOD: &[u8] = include_bytes!("../fixtures/ball-444.jpg");

/// A robot that looks at a red ball.
async fn before_a_ball() -> Rig {
    let world = format!("{QUIET_WORLD}\nballs:\n  - {{ at: [4, 4.9], colour: red }}\n");
    Rig::new(&world, Firmware::default()).await
}

/// Damaged frames: cut short, with a part of the data missing, not a JPEG, and empty.
fn broken() -> [Bytes; 4] {
    let torn = [&GOOD[..GOOD.len() - 300], &GOOD[GOOD.len() - 50..]].concat();
    let cut = Bytes::from_static(&GOOD[..1200]);
    [
        cut,
        torn.into(),
        Bytes::from_static(b"no picture"),
        Bytes::new(),
    ]
}

/// Sends damaged frames between the good ones, forever. The period differs from the simulator's 20
/// ms: otherwise every good frame could be followed by a damaged one in the same write, and the
/// newest frame wins.
async fn break_frames(sim: Handle) {
    let mut pause = tokio::time::interval(Duration::from_millis(37));
    for jpeg in broken().iter().cycle() {
        pause.tick().await;
        sim.inject(Report::Video(jpeg.clone()));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_behaviour_continues_between_damaged_frames_and_the_log_reports_them_rarely() {
    let rig = before_a_ball().await;
    let mut run = rig.run(
        "local seen = 0
         robot.on('frame', function(f)
             if f:find_blobs('red')[1] then seen += 1 end
             if seen == 1 then robot.move(20, 20) end
             if seen == 30 then print('thirty balls') script.stop() end
         end)",
    );
    let troubles = tokio::spawn(break_frames(rig.sim.clone()));
    let moved = rig.heard_motion(0).await;
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    troubles.abort();
    rig.heard_stop(moved).await;
    let text = run.text();
    assert_contains(&text, &["thirty balls"]);
    let told: Vec<&str> = text
        .lines()
        .filter(|line| line.contains("damaged frame"))
        .collect();
    // One line for the first, one for every ten seconds, and one for the rest at the end.
    assert!((2..=12).contains(&told.len()), "{text}");
    assert!(told.iter().all(|line| line.contains("WARN")), "{text}");
    assert!(told.last().unwrap().contains("damaged frames so far"));
    assert!(!text.contains("ERROR"), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_frame_behind_a_good_one_in_the_same_write_does_not_replace_it() {
    let rig = before_a_ball().await;
    // The simulator's own frames are wider.
    let script = "local seen = 0
         robot.on('frame', function(f)
             if f.width ~= 99 then return end
             seen += 1
             if seen == 10 then print('ten good ones') script.stop() end
         end)";
    let mut run = rig.run(script);
    let pairs = async {
        let mut pause = tokio::time::interval(Duration::from_millis(37));
        let broken = broken();
        let broken = broken.iter().filter(|jpeg| validate_markers(jpeg).is_err());
        for (number, jpeg) in broken.cycle().enumerate() {
            pause.tick().await;
            rig.sim.inject(Report::Video(Bytes::from_static(GOOD)));
            // Only the newest frame waits in the simulator. On a busy machine it may never write
            // the first of two frames that arrive at the same moment.
            if number % 2 == 1 {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            rig.sim.inject(Report::Video(jpeg.clone()));
        }
    };
    let code = tokio::select! {
        code = run.code() => code,
        () = pairs => None,
    };
    assert_eq!(code, Some(0), "{}", run.text());
    let text = run.text();
    assert_contains(&text, &["ten good ones"]);
    assert_contains(&text, &["damaged frame"]);
}

/// Pixels that are red, as far as JPEG preserves the colour of a box next to green.
fn box_pixels(path: &Path) -> usize {
    let picture = image::open(path).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (320, 240));
    let is_box = |[r, g, b]: [u8; 3]| g > 170 && r < 190 && b < 150 && g > r.saturating_add(40);
    picture.pixels().filter(|pixel| is_box(pixel.0)).count()
}

fn pictures(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut pictures: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "jpg"))
        .collect();
    pictures.sort_unstable();
    pictures
}

#[tokio::test(flavor = "multi_thread")]
async fn annotate_shows_a_person_what_a_behaviour_saw() {
    let rig = before_a_ball().await;
    let script = rig.file(
        "watch.lua",
        "local tracker = vision.tracker{colour = 'red'}
         robot.on('frame', function(f) tracker:update(f) f:find_blobs('blue') end)",
    );
    let kept = rig.folder().join("marked");
    let begun = Instant::now();
    let args = [
        "run",
        script.to_str().unwrap(),
        "--robot",
        &rig.address,
        "--annotate",
        "marked",
    ];
    let mut run = rig.spykee(&args);
    let folder = kept.join("watch");
    let several = async {
        while pictures(&folder).len() < 4 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let waited = timeout(WAIT_LIMIT, several).await;
    assert!(waited.is_ok(), "{}", run.text());
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    let pictures = pictures(&folder);
    assert!(pictures[0].ends_with("00.jpg"), "{pictures:?}");
    let most = 2 + 2 * begun.elapsed().as_secs() as usize + 2;
    assert!(
        pictures.len() <= most,
        "{pictures:?} in {:?}",
        begun.elapsed()
    );
    for picture in &pictures[1..] {
        assert!(box_pixels(picture) > 50, "no box in {}", picture.display());
    }
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!([mode(&kept), mode(&folder)], [0o700; 2]);
    assert!(pictures.iter().all(|picture| mode(picture) == 0o600));
    let text = run.text();
    let warns = |line: &str| line.contains("WARN") && !line.contains("the machine stalled");
    assert!(!text.lines().any(warns), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn without_annotate_no_frame_is_kept() {
    let rig = before_a_ball().await;
    let mut run = rig.run("robot.wait_frame(9):find_blobs('red') print('seen')");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["seen"]);
    assert!(pictures(&rig.folder().join("spykee-data/script")).is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unusable_folder_is_refused_before_the_robot_moves() {
    let rig = before_a_ball().await;
    let script = rig.file("script.lua", "robot.move(50, 50)");
    rig.file("file", "");
    for folder in ["file", "spykee-data"] {
        let args = [
            "run",
            script.to_str().unwrap(),
            "--robot",
            &rig.address,
            "--annotate",
            folder,
        ];
        let mut run = rig.spykee(&args);
        assert_eq!(run.code().await, Some(2), "{}", run.text());
        assert_contains(&run.text(), &["--annotate"]);
    }
    assert_eq!(rig.commands(0), []);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_script_sees_the_same_in_frames_that_arrive_in_pieces() {
    let world = format!(
        "{QUIET_WORLD}\nballs:\n  - {{ at: [4, 4.9], colour: red }}\ncamera: {{ noise: 0 }}\n"
    );
    let mut seen = Vec::new();
    for faults in [
        "[]",
        "[{ fault: split }]",
        "[{ fault: drip, bytes: 65000, towards: client }]",
    ] {
        let world = World::from_yaml(&world, "ball").unwrap();
        let faults = Fault::list_from_yaml(&format!("faults: {faults}"), "faults").unwrap();
        let options = Options {
            faults: Some(faults),
            ..Options::default()
        };
        let rig = Rig::with(world, options).await;
        let mut run = rig.run(
            "local seen = 0
             robot.on('frame', function(frame)
                 local ball = frame:find_blobs('red')[1]
                 print(`red: {ball.pixels} at {ball.cx} {ball.cy}`)
                 seen += 1
                 if seen == 12 then script.stop() end
             end)",
        );
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let text = run.text();
        let lines = text.lines().filter_map(|line| line.split_once("red: "));
        seen.extend(lines.map(|(_, ball)| {
            ball.split_whitespace()
                .take(4)
                .collect::<Vec<_>>()
                .join(" ")
        }));
    }
    assert_eq!(seen.len(), 36);
    seen.dedup();
    assert_eq!(seen.len(), 1, "{seen:?}");
}
