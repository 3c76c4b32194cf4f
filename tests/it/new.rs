//! `spykee new`: the project that it makes works at once.

use crate::rig::{Rig, assert_contains, exact_yaml, moves, run_in, sized};

#[tokio::test]
async fn a_new_project_drives_at_once_and_is_never_overwritten() {
    let rig = Rig::quiet().await;
    let mut run = rig.spykee(&["new", "mine"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["spykee run mine.lua --sim"]);
    let file = rig.folder().join("mine/mine.lua");
    std::fs::write(&file, "-- changed").unwrap();
    let mut again = rig.spykee(&["new", "mine"]);
    assert_eq!(again.code().await, Some(2), "{}", again.text());
    assert_contains(&again.text(), &["already exists"]);
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
        let heard = rig.sim.heard_count();
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

/// The scenario that each template must pass; `FILE`, `PARTS` and `MINUTES` are filled in. The robot is
/// exact: a genuine one touches the station beside its contacts when it docks, which counts as a collision.
const LONG: &str = r#"
scenario("lives through many charges", { world = "exact.yaml", limit = 90000, fps = 2 }, function(sim)
	sim:run("FILE")
	local driven, charges = 0, 0
	for part = 1, PARTS do
		for _ = 1, MINUTES do
			local docked = sim:docked()
			sim:wait(60)
			charges += if docked and not sim:docked() then 1 else 0
		end
		expect(sim:distance() > driven + 0.5, `in part {part} it drove {sim:distance() - driven} m only`)
		driven = sim:distance()
	end
	expect(not sim:ended("mine"), `it has ended: {sim:ended("mine")}`)
	expect(59 * charges >= 3 * PARTS * MINUTES, `it left its station {charges} times only`)
	expect(sim:collisions() <= PARTS * MINUTES // 59, `it ran into something {sim:collisions()} times`)
end)
"#;

/// In the living room a battery lasts for two minutes, so an hour has 17 charges. For each change half
/// an hour, in `scripts/nightly` a day.
#[test]
fn templates_run_for_hours_with_many_charges() {
    for (template, parts) in [("patrol", sized(1, 24)), ("follow", 1)] {
        let folder = tempfile::tempdir().unwrap();
        let spykee = |args: &[&str]| {
            let ended = run_in(folder.path(), args);
            assert_eq!(ended.code, Some(0), "{template}: {}", ended.text());
        };
        spykee(&["new", "mine", "--template", template]);
        spykee(&["test", "mine"]);
        let scenario = LONG.replace("PARTS", &parts.to_string());
        let scenario = scenario.replace("MINUTES", sized("29", "59"));
        let scenario = scenario.replace("FILE", "mine.lua");
        std::fs::write(folder.path().join("mine/day_test.lua"), scenario).unwrap();
        let exact = exact_yaml("living_room");
        std::fs::write(folder.path().join("mine/exact.yaml"), exact).unwrap();
        spykee(&["test", "mine/day_test.lua"]);
    }
}
