//! `spykee new`: what it makes works at once.

use crate::rig::{Rig, moves};

#[tokio::test]
async fn a_new_project_drives_at_once_and_is_never_overwritten() {
    let rig = Rig::quiet().await;
    let mut run = rig.spykee(&["new", "mine"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert!(
        run.text().contains("spykee run mine.lua --sim"),
        "{}",
        run.text()
    );
    let file = rig.folder().join("mine/mine.lua");
    std::fs::write(&file, "-- changed").unwrap();
    let mut again = rig.spykee(&["new", "mine"]);
    assert_eq!(again.code().await, Some(2), "{}", again.text());
    assert!(
        again.text().contains("is there already"),
        "{}",
        again.text()
    );
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "-- changed");
    let mut wrong = rig.spykee(&["new", "../mine"]);
    assert_eq!(wrong.code().await, Some(2), "{}", wrong.text());
}

#[tokio::test]
async fn every_template_runs_and_passes_the_check() {
    let rig = Rig::quiet().await;
    for template in ["patrol", "follow", "empty"] {
        let mut run = rig.spykee(&["new", template, "--template", template]);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let config = rig.folder().join(template).join("spykee.yaml");
        let config = config.to_str().unwrap();
        let heard = rig.commands(0).len();
        let mut run = rig.spykee(&[
            "run",
            "--config",
            config,
            "--robot",
            &rig.address,
            "--for",
            "3",
        ]);
        if template != "empty" {
            rig.heard_motion(heard).await;
        }
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let drove = rig.commands(heard).iter().any(moves);
        assert_eq!(drove, template != "empty", "{}", run.text());
    }
}
