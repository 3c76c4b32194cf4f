//! Invariants at every moment of a history while the battery is low.

use super::*;

/// What moves a robot with a low battery: legs of the watchdog, and loans.
#[derive(Debug, Default)]
pub(super) struct WayHome {
    /// Since when it moves.
    moves: Option<Instant>,
    /// Since when the tracks are lent, and to which behaviour.
    lent: Option<(Instant, BehaviourId)>,
}

impl WayHome {
    const LONGEST_LEG: Duration = Leg::TURN.saturating_add(Leg::LONGEST);

    /// While low: any motion is an allowed leg, slow and short, or an allowed loan.
    pub(super) fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play { dog, known, .. } = moment.play;
        self.see_loan(moment)?;
        for command in &sent(&moment.acts) {
            if !known.low {
                break;
            }
            let Command::Move { left, right } = *command else {
                continue;
            };
            let (left, right) = (left.unsigned_abs(), right.unsigned_abs());
            let cap = f64::from(moment.play.limits.rescue_power.get()) * 0.9;
            let slow = f64::from(left.max(right)) <= cap;
            let is_leg = left == right && [0, 27].contains(&left);
            prop_assert!(is_leg || (self.lent.is_some() && slow), "{:?}", command);
        }
        if known.low && dog.moving() {
            self.see_motion(moment)
        } else {
            self.moves = None;
            Ok(())
        }
    }

    fn see_motion(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            known, limits, now, ..
        } = moment.play;
        let began = *self.moves.get_or_insert(*now);
        let ends = match self.lent {
            Some((since, _)) => since + limits.rescue_time.get(),
            None => began + WayHome::LONGEST_LEG,
        };
        moment.drives_until(ends)?;
        let leg = limits.recovery_legs && known.not_found;
        prop_assert!(self.lent.is_some() || leg, "{:?}", known);
        Ok(())
    }

    fn see_loan(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            ..
        } = moment.play;
        let Some(by) = dog.borrower() else {
            self.lent = None;
            return Ok(());
        };
        prop_assert_eq!(known.rescuer, Some(by));
        prop_assert!(limits.rescue != Rescue::Off);
        let (since, whose) = *self.lent.get_or_insert((*now, by));
        prop_assert_eq!(whose, by);
        moment.drives_until(since + limits.rescue_time.get())
    }
}

/// Since when a robot with a low battery waits for BASE_FIND.
#[derive(Debug, Default)]
pub(super) struct LongestWait(Option<Instant>);

impl LongestWait {
    /// A robot that is low, online and not charging is sent BASE_FIND again within this time.
    fn longest(limits: &Limits) -> Duration {
        let moment = Duration::from_secs(1);
        let pause = limits.dock_pause.get().max(moment);
        let on_contact = limits.charge_timeout.get() * 2 + DockTracker::LONGEST_LEAVING;
        let driven = limits.rescue_time.get() + WayHome::LONGEST_LEG;
        limits.dock_timeout.get() + on_contact + pause + driven + moment
    }

    pub(super) fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            slept,
        } = moment.play;
        let waits = known.online && known.low && dog.place() != DockState::Charging;
        if !waits || moment.sends(&FIND) {
            self.0 = waits.then_some(*now);
            return Ok(());
        }
        let since = *self.0.get_or_insert(*now);
        let since = slept.map_or(since, |slept| slept.max(since));
        let waited = *now - since;
        prop_assert!(
            waited <= LongestWait::longest(limits),
            "{:?}: {:?}",
            waited,
            known
        );
        Ok(())
    }
}
