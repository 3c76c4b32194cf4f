//! Counts the votes of the witnesses of a comparison: on each side of the picture, how many were
//! asked and how many found that the camera stood still.

/// The votes; see the module.
#[derive(Debug, Default)]
pub(super) struct Votes {
    asked: [u32; 2],
    still: [u32; 2],
}

impl Votes {
    pub(super) fn add(&mut self, right: bool, still: bool) {
        self.asked[usize::from(right)] += 1;
        self.still[usize::from(right)] += u32::from(still);
    }

    pub(super) fn count(&self) -> u32 {
        self.asked[0] + self.asked[1]
    }

    /// The share of all witnesses that found the camera still.
    pub(super) fn share(&self) -> f64 {
        let still = self.still[0] + self.still[1];
        f64::from(still) / f64::from(self.count().max(1))
    }

    /// The share on the side where it is smaller; `None` if a side has fewer than `fewest`
    /// witnesses.
    pub(super) fn least_share(&self, fewest: u32) -> Option<f64> {
        let share = |side: usize| {
            let (still, asked) = (self.still[side], self.asked[side]);
            (asked >= fewest).then(|| f64::from(still) / f64::from(asked))
        };
        Some(share(0)?.min(share(1)?))
    }
}
