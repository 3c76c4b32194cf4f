//! The time of day for scripts: the computer's, or the simulation's.

use crate::rig::{QUIET_WORLD, Rig, assert_contains, run_spykee, succeed};

const TELLS: &str = "
for _ = 1, 3 do
    local date = clock.date()
    log.info(`it is {date.text}, {date.weekday}, {date.zone}, {date.offset // 3600} h`)
    task.wait(3600)
end
";

#[tokio::test(flavor = "multi_thread")]
async fn in_virtual_time_the_clock_follows_the_change_to_summer_time() {
    let rig = Rig::quiet().await;
    rig.file("tells.lua", TELLS);
    rig.file("world.yaml", QUIET_WORLD);
    rig.file("spykee.yaml", "time_zone: Europe/Rome\n");
    let args = ["run", "tells.lua", "--sim", "world.yaml", "--fast"];
    let (code, text) =
        run_spykee(&rig, &[&args[..], &["--date", "2026-03-29 00:30"]].concat()).await;
    assert_eq!(code, Some(0), "{text}");
    for line in [
        "it is 2026-03-29 00:30:0", // the login takes its time
        "it is 2026-03-29 01:30:0",
        "it is 2026-03-29 03:30:0",
        "sunday, Europe/Rome, 2 h",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
    // Without a date, the virtual clock is the same on every computer.
    let (_, text) = run_spykee(&rig, &args).await;
    assert_contains(&text, &["it is 2026-01-01 10:00:0"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_script_in_its_own_process_has_the_date_of_the_simulation() {
    let rig = Rig::quiet().await;
    rig.file(
        "tells.lua",
        "local date = clock.date() log.info(`it is {date.text} {date.zone}`) \
                           log.info(`{clock.date(0).text} {clock.now() // 86400}`)",
    );
    rig.file("world.yaml", QUIET_WORLD);
    rig.file("spykee.yaml", "time_zone: America/New_York\n");
    let date = ["--date", "2026-07-04 12:00"];
    let args = [&["run", "tells.lua", "--sim", "world.yaml"][..], &date].concat();
    let text = succeed(&rig, &args).await;
    assert_contains(&text, &["it is 2026-07-04 12:0", "America/New_York"]);
    assert_contains(&text, &["1969-12-31 19:00:00 20638"]);
    let robot = ["run", "tells.lua", "--robot", &rig.address];
    let (code, text) = run_spykee(&rig, &[&robot[..], &date].concat()).await;
    assert_eq!(code, Some(2), "{text}");
    assert_contains(&text, &["--date needs --sim"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scenario_sets_the_clock() {
    let rig = Rig::quiet().await;
    rig.file(
        "night.lua",
        "
while true do
    local hour = clock.date().hour
    robot.led('left', hour >= 22 or hour < 7)
    task.wait(60)
end",
    );
    rig.file(
        "night_test.lua",
        "
scenario('puts the light on at night', { world = 'playpen', limit = 40000 }, function(sim)
    sim:clock('2026-03-28 21:30')
    sim:run()
    sim:wait(600)
    expect(not sim:leds().left, 'too early')
    expect(sim:wait_until(function() return sim:leds().left end, 1300), 'dark at ten')
    sim:clock('2026-03-29 07:00')
    expect(sim:wait_until(function() return not sim:leds().left end, 100), 'still on')
    local fine = pcall(sim.clock, sim, 'tomorrow')
    expect(not fine, 'no date')
end)",
    );
    succeed(&rig, &["test", "night_test.lua"]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_night_of_service_passes_in_virtual_time_across_a_clock_change() {
    let rig = Rig::quiet().await;
    rig.file(
        "patrol.lua",
        "log.info('on my way') robot.move(20, 20, 2) robot.move(-20, -20, 2)",
    );
    rig.file("world.yaml", QUIET_WORLD);
    rig.file(
        "spykee.yaml",
        "time_zone: Europe/Rome\nbehaviours:\n- file: patrol.lua\nschedule:\n\
                             - { run: patrol, at: '0 9,21 * * *', for: 30m }\n",
    );
    let seconds = (13 * 3600).to_string();
    let args = [
        "serve",
        "--sim",
        "world.yaml",
        "--fast",
        "--for",
        &seconds,
        "--date",
        "2026-03-28 20:00",
        "--seed",
        "7",
    ];
    let text = succeed(&rig, &args).await;
    assert_eq!(text.matches("on my way").count(), 2, "{text}");
    assert_eq!(text.matches("starts by the timetable").count(), 2);
    assert_contains(&text, &["planned for Sun 2026-03-29 09:00"]);
    assert_contains(&text, &["the idle robot is on its station"]);
}
