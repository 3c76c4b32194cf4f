//! A STOP that is executed: how late on a robot that executes commands from a queue, and whether at all
//! when the link breaks around the end of a run.

pub mod breaks;
pub mod network;
pub mod queue;

/// The smallest of these values that `percent` of them do not exceed; `None` if there are none.
fn percentile(values: &[f64], percent: usize) -> Option<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let rank = (values.len() * percent).div_ceil(100);
    values.get(rank.saturating_sub(1)).copied()
}
