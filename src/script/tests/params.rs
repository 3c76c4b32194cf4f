use super::*;
use crate::script::{GivenParam, ParamOrigin, ParamValue};

const SPEED: &str = "local p = params.declare{ speed = {default = 40, min = 10, max = 100, unit = '%', doc = 'how fast'},
    mode = {default = 'calm', choices = {'calm', 'wild'}}, loud = {default = false} } ";

fn with(source: &str, given: &[(&str, &str)]) -> Rig {
    Rig::with(source, |options| {
        for (name, value) in given {
            let value = ParamValue::Text((*value).to_owned());
            let origin = ParamOrigin::CommandLine;
            options
                .params
                .insert((*name).to_owned(), GivenParam { value, origin });
        }
    })
}

#[test]
fn given_values_replace_the_defaults() {
    let source = format!("{SPEED} print(p.speed, p.mode, p.loud)");
    assert_eq!(with(&source, &[]).texts(), ["40 calm false"]);
    let given = [("speed", "55.5"), ("mode", "wild"), ("loud", "true")];
    assert_eq!(with(&source, &given).texts(), ["55.5 wild true"]);
}

#[test]
fn a_bad_value_ends_the_script_before_anything_moves_even_inside_pcall() {
    for (name, value, words) in [
        (
            "speed",
            "500",
            "--param speed=500: speed must be a number from 10 to 100 %",
        ),
        ("speed", "fast", "--param speed=fast: "),
        ("speed", "nan", "--param speed=nan: "),
        ("speed", "", "--param speed=: "),
        ("mode", "crazy", "mode must be one of calm, wild"),
        ("loud", "yes", "loud must be true or false"),
        ("sped", "50", "did you mean 'speed'?"),
    ] {
        let rig = with(
            &format!("robot.move(9, 9) pcall(function() {SPEED} end) robot.move(50, 50)"),
            &[(name, value)],
        );
        rig.assert_ended(EndReason::Error, words);
        assert_eq!(rig.intents, []);
    }
}

#[test]
fn a_value_of_the_config_must_have_the_declared_type() {
    let rig = Rig::with(SPEED, |options| {
        let value = ParamValue::Text("50".to_owned());
        let origin = ParamOrigin::Config("spykee.yaml".to_owned());
        let given = GivenParam { value, origin };
        options.params.insert("speed".to_owned(), given);
    });
    let words = "spykee.yaml: params: speed: 50: speed must be a number from 10 to 100 %";
    rig.assert_ended(EndReason::Error, words);
}

#[test]
fn values_for_a_script_that_declares_nothing_are_refused() {
    for source in [
        "robot.move(50, 50) task.wait(1)",
        "print('done')",
        "robot.move(9, 9, 1)",
        "task.wait(1) params.declare{speed = {default = 1}}",
    ] {
        let rig = with(source, &[("speed", "50")]);
        rig.assert_ended(EndReason::Error, "the script declares no parameters");
        assert_eq!(rig.intents, []);
    }
}

#[test]
fn mistakes_in_a_declaration_are_reported() {
    for (source, words) in cases(
        "params.declare() => it needs a table
         params.declare{ speed = 40 } => speed must be a table
         params.declare{ speed = {} } => speed: default is missing
         params.declare{ speed = {default = 5, min = 10} } => speed: default must be a number of at least 10
         params.declare{ speed = {defualt = 5} } => did you mean 'default'?
         params.declare{ speed = {default = 0/0} } => finite number
         params.declare{ speed = {default = true, max = 3} } => for numbers only
         params.declare{ ['a b'] = {default = 1} } => is not a name
         params.declare{ {default = 1} } => names are texts
         params.declare{} params.declare{} => called before
         local p = params.declare{ speed = {default = 1} } print(p.sped) => did you mean 'speed'?
         local p = params.declare{ speed = {default = 1} } p.speed = 2 => readonly",
    ) {
        let text = failure(source);
        assert!(text.contains(words), "{source}: {text}");
    }
}

#[test]
fn no_metamethod_of_a_declaration_runs() {
    assert_eq!(
        printed(
            "local evil = {__index = function() error('ran') end, __len = function() error('ran') end, __iter = function() error('ran') end}
             local p = params.declare(setmetatable({ a = setmetatable({default = 1}, evil) }, evil)) print(p.a)"
        ),
        "1"
    );
}

#[test]
fn a_parameter_that_is_declared_live_changes_within_its_bounds_while_the_script_runs() {
    let mut rig = with(
        "local p = params.declare{ speed = {default = 40, min = 10, max = 100, unit = '%', live = true},
            mode = {default = 'calm'} }
        task.every(1, function() print(p.speed, p.mode) end) ",
        &[],
    );
    let shown: Vec<_> = rig
        .params
        .iter()
        .map(|param| (&*param.name, param.live))
        .collect();
    assert_eq!(shown, [("mode", false), ("speed", true)]);
    rig.script
        .set_live_param("speed", ParamValue::Number(55.0), rig.now);
    rig.pass(1.5);
    assert_eq!(rig.texts(), ["55 calm"]);
    assert_eq!(rig.params[1].value, ParamValue::Number(55.0));
    for (name, value, words) in [
        (
            "speed",
            ParamValue::Number(101.0),
            "speed must be a number from 10 to 100 %",
        ),
        (
            "speed",
            ParamValue::Number(f64::NAN),
            "speed must be a number from 10 to 100 %",
        ),
        (
            "speed",
            ParamValue::Text("60".into()),
            "speed must be a number from 10 to 100 %",
        ),
        (
            "mode",
            ParamValue::Text("wild".into()),
            "mode cannot be changed while the script runs",
        ),
        (
            "sped",
            ParamValue::Number(20.0),
            "the script declares no parameter 'sped'",
        ),
    ] {
        rig.script.set_live_param(name, value, rig.now);
        rig.run();
        assert_eq!(rig.texts().last(), Some(&words));
    }
    rig.pass(1.0);
    assert_eq!(rig.texts().last(), Some(&"55 calm"));
}

#[test]
fn a_script_itself_cannot_change_a_live_parameter() {
    let rig = with(
        "local p = params.declare{ speed = {default = 40, live = true} }
        print(pcall(function() p.speed = 50 end)) print(pcall(rawset, p, 'speed', 50)) print(p.speed)",
        &[],
    );
    let texts = rig.texts();
    assert!(texts[0].starts_with("false"), "{texts:?}");
    assert_eq!(texts.last(), Some(&"40"));
}
