//! Invariants at every moment of a history while the battery is low.

use super::*;

/// What moves a robot with a low battery: blind moves of the watchdog, and grants.
#[derive(Debug, Default)]
pub(super) struct WayHome {
    /// Since when it moves.
    moves: Option<Instant>,
    /// Since when the tracks are granted, and to which behaviour.
    granted: Option<(Instant, BehaviourId)>,
}

impl WayHome {
    const LONGEST_BLIND_MOVE: Duration = BlindMove::TURN.saturating_add(BlindMove::LONGEST);

    /// While low: any motion is an allowed blind move, slow and short, or an allowed grant.
    pub(super) fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play { dog, known, .. } = moment.play;
        self.see_grant(moment)?;
        for command in &sent(&moment.acts) {
            if !known.low {
                break;
            }
            let Command::Move { left, right } = *command else {
                continue;
            };
            let left = left.unsigned_abs();
            let right = right.unsigned_abs();
            let cap = f64::from(moment.play.limits.rescue_power.get()) * 0.9;
            let slow = f64::from(left.max(right)) <= cap;
            let is_blind_move = left == right && [0, 27].contains(&left);
            prop_assert!(
                is_blind_move || (self.granted.is_some() && slow),
                "{:?}",
                command
            );
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
        let ends = match self.granted {
            Some((since, _)) => since + limits.rescue_time.get(),
            None => began + WayHome::LONGEST_BLIND_MOVE,
        };
        moment.drives_until(ends)?;
        let blind_move = limits.blind_moves && known.not_found;
        prop_assert!(self.granted.is_some() || blind_move, "{:?}", known);
        Ok(())
    }

    fn see_grant(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            ..
        } = moment.play;
        let Some(by) = dog.grantee() else {
            self.granted = None;
            return Ok(());
        };
        prop_assert_eq!(known.rescuer, Some(by));
        prop_assert!(limits.rescue != Rescue::Off);
        let (since, whose) = *self.granted.get_or_insert((*now, by));
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
        let driven = limits.rescue_time.get() + WayHome::LONGEST_BLIND_MOVE;
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
        let waits = known.online && known.low && dog.dock_state() != DockState::Charging;
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
