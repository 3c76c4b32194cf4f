//! Tests that each ready-made behaviour does what its first comment says, in the simulator.

use std::path::Path;

use spykee::wire::{Command, Led, Sound};

use crate::rig::{Rig, assert_contains, run_in};

#[tokio::test(flavor = "multi_thread")]
async fn hello_lights_up_sounds_and_ends_without_driving() {
    let rig = Rig::quiet().await;
    let hello = concat!(env!("CARGO_MANIFEST_DIR"), "/behaviours/hello.lua");
    let mut run = rig.spykee(&["run", hello, "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let heard = rig.commands(0);
    for led in [Led::Left, Led::Flash, Led::Right] {
        assert!(
            heard.contains(&Command::Led { led, on: true }),
            "{led:?}: {heard:?}"
        );
    }
    assert!(heard.contains(&Command::Play(Sound::Robot)), "{heard:?}");
    assert!(heard.contains(&Command::Play(Sound::Laugh)), "{heard:?}");
    assert!(!heard.iter().any(crate::rig::moves), "{heard:?}");
    assert_contains(&run.text(), &["my battery is at"]);
}

/// Plays the scenarios that are quick; `scripts/score-behaviours` plays all of them with 20 seeds.
#[test]
fn ready_behaviours_pass_their_scenarios() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours");
    let pictures = tempfile::tempdir().unwrap();
    let names = ["patrol", "dock_now", "follow_colour"];
    let files = names.map(|name| home.join(format!("{name}_test.lua")));
    let files = files.iter().map(|file| file.to_str().unwrap());
    let mut args = vec!["test", "--seed", "3", "--pictures", "."];
    args.extend(files);
    let played = run_in(pictures.path(), &args);
    let said = played.out;
    assert_eq!(played.code, Some(0), "{said}");
    assert_contains(&said, &[" runs passed; "]);
}
