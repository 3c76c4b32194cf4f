use super::super::story::tests::record;
use super::*;
use serde_json::json;

fn story(levels: Vec<Level>, runs: Vec<Run>) -> Story {
    let at = |seconds| record(seconds, json!({})).at;
    Story {
        since: at(0),
        until: at(86_400),
        robots: vec!["SPYKEE0001".to_owned()],
        levels,
        marks: Vec::new(),
        runs,
        offline: Vec::new(),
    }
}

fn level(seconds: i64, percent: f64, charging: bool) -> Level {
    let at = record(seconds, json!({})).at;
    Level {
        at,
        percent,
        charging,
    }
}

#[test]
fn phases_follow_each_other_without_a_gap() {
    let levels: Vec<Level> = (0..10)
        .map(|at| level(at * 60, 50.0, (3..6).contains(&at)))
        .collect();
    assert_eq!(
        phases(&levels),
        [(0, 3, false), (3, 6, true), (6, 9, false)]
    );
    assert_eq!(phases(&levels[..1]), []);
}

#[test]
fn the_level_is_drawn_at_its_height_and_gaps_stay_empty() {
    let levels = (0..720).map(|minute| level(minute * 60, 80.0, false));
    let picture = draw(&story(levels.collect(), Vec::new()), &TimeZone::UTC);
    let blue = |x: u32, y: u32| {
        let pixel = picture.get_pixel(x, y).0;
        pixel[2] > 150 && pixel[0] < 100
    };
    let y = Chart::y(80.0) as u32;
    let left = 200;
    assert!(blue(left, y), "{:?}", picture.get_pixel(left, y));
    assert!(
        !blue(left, y + 20) && !blue(1000, y),
        "half of the day is not known"
    );
}

#[test]
fn empty_and_very_large_stories_can_be_drawn() {
    draw(&story(Vec::new(), Vec::new()), &TimeZone::UTC);
    let run = |number: i64| Run {
        session: 1,
        behaviour: format!("behaviour-with-a-long-name-{number}\u{1b}[2J"),
        began: Some(record(number * 60, json!({})).at),
        ended: None,
        seconds: None,
        reason: "error".to_owned(),
        message: String::new(),
    };
    let picture = draw(
        &story(Vec::new(), (0..500).map(run).collect()),
        &TimeZone::UTC,
    );
    assert!(picture.height() < 1000);
}

/// Three typical days of a patrol: two trips a day, home when the battery is low, and one docking
/// that fails at first.
fn example() -> Story {
    let (mut levels, mut marks, mut runs) = (Vec::new(), Vec::new(), Vec::new());
    let at = |minute: i64| record(minute * 60, json!({})).at;
    let (mut percent, mut charging, mut failed) = (88.0_f64, true, false);
    for minute in 0..3 * 1440 {
        // The picture begins at 16:13 in Rome.
        let hour = (minute + 16 * 60 + 13) / 60 % 24;
        let out = (9..11).contains(&hour) || (21..23).contains(&hour);
        let drains = if out && !charging { 0.62 } else { 0.01 };
        percent += if charging { 0.45 } else { -drains };
        percent = percent.clamp(0.0, 100.0);
        if out && charging && percent > 70.0 {
            charging = false;
            let began = Some(at(minute));
            let mut run = |behaviour: &str, until: i64, reason: &str| {
                runs.push(Run {
                    session: 1,
                    behaviour: behaviour.to_owned(),
                    began,
                    ended: Some(at(until)),
                    seconds: None,
                    reason: reason.to_owned(),
                    message: String::new(),
                });
            };
            run("patrol", minute + 110, "done");
            run(
                "guard",
                minute + 118,
                if minute > 2000 && minute < 2600 {
                    "error"
                } else {
                    "done"
                },
            );
        }
        let home = !charging && (percent < 22.0 || !out);
        if home && minute > 1500 && !failed {
            failed = true;
            let mark = |at, good, alarm| Mark { at, good, alarm };
            marks.extend([
                mark(at(minute), false, false),
                mark(at(minute + 12), false, true),
            ]);
            charging = false;
            percent -= 3.0;
            marks.push(mark(at(minute + 24), true, false));
        } else if home {
            charging = true;
            marks.push(Mark {
                at: at(minute),
                good: true,
                alarm: false,
            });
        }
        let away = (1750..1840).contains(&minute);
        if !away {
            levels.push(Level {
                at: at(minute),
                percent: percent.round(),
                charging,
            });
        }
    }
    Story {
        since: at(0),
        until: at(3 * 1440),
        robots: vec!["SPYKEE0001".to_owned()],
        levels,
        marks,
        runs,
        offline: vec![(at(1750), at(1840))],
    }
}

#[test]
#[ignore = "writes the picture of the guide; scripts/pictures runs it"]
fn the_picture_of_the_guide() {
    let zone = TimeZone::get("Europe/Rome").unwrap();
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/behaviours/pictures/history.png"
    );
    draw(&example(), &zone).save(path).unwrap();
}
