use super::*;
use proptest::prelude::*;

fn session() -> Rig {
    Rig::with("", |options| {
        options.interactive = true;
        options.limits.callback_budget_ms = 2_000;
    })
}

impl Rig {
    /// Types a line that the next line may continue.
    fn types(&mut self, text: &str) {
        self.script.evaluate(text, true, self.now);
        self.run();
    }

    fn answer(&mut self, text: &str) -> Evaluated {
        self.types(text);
        self.answers.pop().expect("no answer")
    }
}

fn values(texts: &[&str]) -> Evaluated {
    Evaluated::Values(texts.iter().map(|&text| text.to_owned()).collect())
}

#[test]
fn a_session_persists_between_lines() {
    let mut rig = session();
    assert_eq!(rig.answer("x = 20"), values(&[]));
    rig.pass(1000.0);
    assert_eq!(rig.answer("x + 1, 'a'"), values(&["21", "\"a\""]));
    assert_eq!(rig.script.ended(), None);
}

#[test]
fn an_incomplete_line_is_reported_as_such_and_a_wrong_one_is_not() {
    let mut rig = session();
    for begun in ["if true then", "function f()", "1 +", "x = {", "print("] {
        assert_eq!(rig.answer(begun), Evaluated::Incomplete, "{begun}");
        rig.script.evaluate(begun, false, rig.now);
        rig.run();
        assert!(
            matches!(rig.answers.pop(), Some(Evaluated::Failed(_))),
            "{begun}"
        );
    }
    for wrong in ["then", "x y", ")", "robot.moev()", "1 + nil"] {
        assert!(matches!(rig.answer(wrong), Evaluated::Failed(_)), "{wrong}");
    }
}

#[test]
fn a_line_that_waits_has_its_result_when_it_is_done() {
    let mut rig = session();
    rig.types("task.wait(2) return 'late'");
    assert_eq!(rig.answers, []);
    rig.pass(3.0);
    assert_eq!(rig.answers, [values(&["\"late\""])]);
}

#[test]
fn a_setpoint_outlives_its_line_and_ends_with_an_interruption() {
    let mut rig = session();
    rig.deliver(connected(false));
    rig.types("robot.move(30, 30)");
    rig.pass(5.0);
    assert!(matches!(rig.take_intents()[..], [Intent::Move { .. }]));
    rig.script.interrupt(rig.now);
    rig.run();
    let intents = rig.take_intents();
    assert!(matches!(intents[0], Intent::Release { .. }), "{intents:?}");
    assert_eq!(intents.last(), Some(&Intent::Stop));
    assert!(!rig.script.has_motion());
}

#[test]
fn an_interruption_ends_the_line_the_tasks_and_the_handlers_and_keeps_the_variables() {
    let mut rig = session();
    rig.deliver(connected(false));
    rig.types("x = 1 task.every(0.5, function() robot.move(9, 9) end) robot.on('docked', print)");
    rig.types("task.wait(100)");
    rig.script.interrupt(rig.now);
    rig.run();
    assert_eq!(rig.answers.pop(), Some(Evaluated::Cancelled));
    rig.take_intents();
    rig.pass(10.0);
    rig.deliver(Event::Docked);
    assert_eq!((rig.take_intents(), rig.texts()), (vec![], vec![]));
    assert_eq!(rig.answer("x"), values(&["1"]));
}

#[test]
fn shown_values_are_bounded_and_run_no_line_of_the_script() {
    let mut rig = session();
    let Evaluated::Values(shown) = rig.answer(
        "(function() local t = setmetatable({}, {
            __tostring = function() error('run') end,
            __iter = function() error('run') end,
            __index = function() error('run') end })
         for i = 1, 100000 do t[i] = string.rep('x', 30) end
         return t, string.rep('\\27[2J', 100000), t end)()",
    ) else {
        panic!("it failed");
    };
    assert_eq!(shown.len(), 3);
    assert!(
        shown
            .iter()
            .all(|text| text.len() < 1000 && !text.contains('\x1b')),
        "{shown:?}"
    );
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in ".{0,60}", more in any::<bool>()) {
        let mut rig = session();
        rig.script.evaluate(&text, more, rig.now);
        rig.run();
        prop_assert!(rig.script.ended().is_some() || !rig.answers.is_empty() || rig.script.next_deadline().is_some());
    }
}
