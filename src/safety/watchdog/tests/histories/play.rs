//! Plays a history: gives facts to a watchdog and lets time pass between them.

use super::*;

/// One step of a random history.
#[derive(Debug, Clone)]
pub(super) enum Step {
    Fact(Fact),
    /// Time passes, and the watchdog is ticked at each of its deadlines.
    Pass(Duration),
    /// The whole machine sleeps: the watchdog is ticked once, at the end.
    Jump(Duration),
    /// The watchdog is ticked though no time has passed.
    Still,
}

/// A watchdog, what is known of its robot, and a clock.
pub(super) struct Play {
    pub(super) dog: Watchdog,
    pub(super) known: Known,
    pub(super) limits: Limits,
    pub(super) now: Instant,
    /// When the whole machine last woke up.
    pub(super) slept: Option<Instant>,
}

/// The watchdog's output at one moment of a history.
pub(super) struct Moment<'a> {
    pub(super) play: &'a Play,
    /// `None` if time has passed instead.
    pub(super) fact: Option<&'a Fact>,
    pub(super) acts: Vec<Act>,
}

impl Moment<'_> {
    pub(super) fn moves(&self) -> bool {
        let moves = |command: &Command| matches!(command, Command::Move { .. });
        sent(&self.acts)
            .iter()
            .any(|command| moves(command) && *command != Command::STOP)
    }

    /// Checks that a robot with a low battery may be moved, and only until `ends`.
    pub(super) fn drives_until(&self, ends: Instant) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            ..
        } = self.play;
        prop_assert!(*now < ends && dog.next_deadline().is_some_and(|due| due <= ends));
        prop_assert!(known.allows_the_way_home(limits, *now), "{:?}", known);
        Ok(())
    }

    pub(super) fn sends(&self, command: &Command) -> bool {
        sent(&self.acts).contains(command)
    }
}

pub(super) type Kept = Result<(), TestCaseError>;

impl Play {
    pub(super) fn new(limits: &Limits) -> Play {
        let now = Instant::now();
        Play {
            dog: Watchdog::new(limits.clone(), now),
            known: Known::default(),
            limits: limits.clone(),
            now,
            slept: None,
        }
    }

    pub(super) fn steps(
        &mut self,
        steps: &[Step],
        see: &mut impl FnMut(Moment<'_>) -> Kept,
    ) -> Kept {
        steps.iter().try_for_each(|step| match step {
            Step::Fact(fact) => self.handle(fact, see),
            Step::Still => self.poll(see),
            Step::Jump(span) => {
                self.now += *span;
                self.slept = Some(self.now);
                self.poll(see)
            }
            Step::Pass(span) => self.pass(*span, see),
        })
    }

    pub(super) fn handle(&mut self, fact: &Fact, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        self.known.record(fact, &self.limits, self.now);
        let acts = self.dog.handle(fact.clone(), self.now);
        self.show(Some(fact), acts, see)
    }

    fn show(
        &mut self,
        fact: Option<&Fact>,
        acts: Vec<Act>,
        see: &mut impl FnMut(Moment<'_>) -> Kept,
    ) -> Kept {
        self.known.pass(&self.limits, self.dog.docked(), self.now);
        self.known.note_acts(&acts);
        self.known.agree(&self.dog, &self.limits)?;
        let play = self;
        see(Moment { play, fact, acts })
    }

    pub(super) fn poll(&mut self, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        let acts = self.dog.poll(self.now);
        self.show(None, acts, see)
    }

    /// After very many deadlines the rest of the span is skipped as if the machine slept.
    pub(super) fn pass(
        &mut self,
        span: Duration,
        see: &mut impl FnMut(Moment<'_>) -> Kept,
    ) -> Kept {
        let end = self.now + span;
        for _ in 0..100 {
            let Some(due) = self.dog.next_deadline().filter(|due| *due <= end) else {
                self.now = end;
                return Ok(());
            };
            prop_assert!(due > self.now, "a deadline that has passed");
            self.now = due;
            self.poll(see)?;
        }
        self.now = end;
        self.slept = Some(end);
        self.poll(see)
    }
}
