use proptest::prelude::*;

use super::*;

fn run(source: &[u8]) {
    let mut options = Options::new("test", "test.lua");
    options.limits.callback_budget_ms = 20;
    let now = Instant::now();
    if let Ok(mut script) = Script::load(source, options, now) {
        for _ in 0..50 {
            script.run_ready(now);
            script.take_output();
        }
        script.stop(EndReason::Cancelled, now);
    }
}

/// Words of the language and of the API, in any order.
fn words() -> impl Strategy<Value = String> {
    let words = "
        robot task script . : ( ) { } move wait spawn on 'frame' 50 -1 0/0 nil function end
        return pcall coroutine wrap yield error = , local x all race timeout cancel stop if then
        for in do while true";
    let words: Vec<&str> = words.split_whitespace().chain(["\n"]).collect();
    let word = prop::sample::select(words);
    prop::collection::vec(word, 0..40).prop_map(|words| words.join(" "))
}

/// A call of the API with values of any kind.
fn call() -> impl Strategy<Value = String> {
    let names = "
        robot.move robot.drive robot.turn robot.led robot.blink robot.play robot.say
        robot.stream robot.dock robot.undock robot.on robot.once robot.wait_for robot.wait_frame
        robot.frame task.wait task.spawn task.delay task.every task.all task.race task.timeout
        script.stop script.on_stop log.info print coroutine.resume coroutine.wrap
        coroutine.close string.split string.gsub table.sort task.spawn(print).join
        task.spawn(print).cancel";
    let methods = ["robot.on('docked', print).off"];
    let names: Vec<&str> = names.split_whitespace().chain(methods).collect();
    let name = prop::sample::select(names);
    let value = prop::sample::select(vec![
        "nil",
        "true",
        "0",
        "-1",
        "1e308",
        "0/0",
        "math.huge",
        "''",
        "'left'",
        "'frame'",
        "{}",
        "{1, 2}",
        "print",
        "function() task.wait(0.1) return 1 end",
        "function() error({}) end",
        "buffer.create(4)",
        "coroutine.create(print)",
        "task.spawn(print)",
        "robot",
        "setmetatable({}, {__index = error, __tostring = error})",
        "vector.create(1, 2, 3)",
    ]);
    (name, prop::collection::vec(value, 0..4)).prop_map(|(name, values)| {
        format!(
            "print(pcall({name}{}))",
            values
                .iter()
                .map(|value| format!(", {value}"))
                .collect::<String>()
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_bytes_load_or_are_refused(source in prop::collection::vec(any::<u8>(), 0..300)) {
        run(&source);
    }

    #[test]
    fn any_text_loads_or_is_refused(source in ".{0,200}") {
        run(source.as_bytes());
    }

    #[test]
    fn any_words_run_or_fail(source in words()) {
        run(source.as_bytes());
    }

    #[test]
    fn any_arguments_are_answered(calls in prop::collection::vec(call(), 1..6)) {
        run(calls.join("\n").as_bytes());
    }
}
