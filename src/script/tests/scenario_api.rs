//! The functions of scenario scripts: the guide documents all of them and no others.

use tokio::time::Instant;

use super::super::{Options, Script};

const GUIDE: &str = include_str!("../../../behaviours/README.md");

#[test]
fn the_guide_names_all_that_a_scenario_can_call_and_nothing_else() {
    let script = Script::empty_scenario(Options::new("test", "test.lua"), Instant::now()).unwrap();
    let names = script.known_names();
    let calls = names.iter().filter_map(|name| name.strip_prefix("sim."));
    let calls: Vec<&str> = calls.collect();
    assert!(calls.len() > 20, "{calls:?}");
    for call in &calls {
        assert!(
            GUIDE.contains(&format!("`sim:{call}(")),
            "sim:{call} is not documented"
        );
    }
    let documented = GUIDE
        .split("`sim:")
        .skip(1)
        .filter_map(|rest| rest.split('(').next());
    for name in documented {
        assert!(calls.contains(&name), "sim:{name} does not exist");
    }
    for absent in ["robot", "store", "vision", "params"] {
        assert!(!names.contains(absent), "{absent}");
    }
}
