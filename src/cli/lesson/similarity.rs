//! Finds scripts of a class with nearly the same text. Ignores lines from the lesson's starter, and
//! texts that are too short: solutions of a few lines are similar without being copied.

/// Texts with at least this similarity, from 0 to 1, are nearly the same.
const NEARLY_THE_SAME: f64 = 0.92;
/// Minimum length of a learner's own text for a comparison, in characters.
const SHORTEST: usize = 60;
/// Maximum number of characters compared.
const LONGEST: usize = 20_000;

/// A pair of texts in a list that are nearly the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    /// Their indices in the list, in ascending order.
    pub(super) places: (usize, usize),
    pub(super) similarity: f64,
}

/// All pairs, the most similar first.
pub(super) fn pairs(texts: &[Option<String>], starter: &str) -> Vec<Pair> {
    let own = |text: &Option<String>| text.as_deref().and_then(|text| own_words(text, starter));
    let own: Vec<Option<String>> = texts.iter().map(own).collect();
    let mut pairs = Vec::new();
    for (first, one) in own.iter().enumerate() {
        for (second, other) in own.iter().enumerate().skip(first + 1) {
            let (Some(one), Some(other)) = (one, other) else {
                continue;
            };
            let similarity = strsim::sorensen_dice(one, other);
            if similarity >= NEARLY_THE_SAME {
                let places = (first, second);
                pairs.push(Pair { places, similarity });
            }
        }
    }
    pairs.sort_by(|one, other| other.similarity.total_cmp(&one.similarity));
    pairs
}

/// The lines that are not in the starter, without spaces; `None` if they are too short.
fn own_words(text: &str, starter: &str) -> Option<String> {
    let given: Vec<String> = starter.lines().map(without_spaces).collect();
    let lines = text.lines().map(without_spaces);
    let own: String = lines.filter(|line| !given.contains(line)).collect();
    (own.chars().count() >= SHORTEST).then(|| own.chars().take(LONGEST).collect())
}

fn without_spaces(line: &str) -> String {
    line.chars().filter(|c| !c.is_whitespace()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STARTER: &str = "-- spykee lesson 5\nrobot.led('all', true)\nrobot.turn(math.rad(360))\n";

    fn script(middle: &str) -> Option<String> {
        Some(format!(
            "{STARTER}robot.on('noise', function(noise)\n  {middle}\n  print('I am awake now', noise.dbfs)\n\
             \tfor count = 1, 3 do robot.play('bip_2') task.wait(0.3) end\nend)\n"
        ))
    }

    #[test]
    fn a_copy_with_other_spaces_and_small_changes_is_found() {
        let one = "robot.led('all', true)";
        let other = "robot.led(  'all',  true )";
        let texts = [
            script(one),
            script(other),
            None,
            script(
                "robot.turn(math.rad(180)) log.info('this is all of my very own idea, and long')",
            ),
        ];
        let found = pairs(&texts, STARTER);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].places, (0, 1));
    }

    #[test]
    fn the_starter_and_short_solutions_are_not_copies() {
        let short = Some(format!("{STARTER}robot.led('all', false)\n"));
        let starter = Some(STARTER.repeat(9));
        assert_eq!(
            pairs(&[short.clone(), short, starter.clone(), starter], STARTER),
            []
        );
    }
}
