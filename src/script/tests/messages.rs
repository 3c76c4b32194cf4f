use std::time::Duration;

use super::*;

#[test]
fn entries_and_messages_are_sent_unchanged() {
    let rig = Rig::new(
        "print(journal.add('moved', {energy = 3.5, where = 'door'}), journal.add('seen'))
         print(notify.send('hello'), notify.send('look', {picture = 'a.jpg'}))",
    );
    assert_eq!(rig.texts(), ["true true", "true true"]);
    let entry = |kind: &str, json: &str| HostReport::Entry {
        kind: kind.to_owned(),
        json: json.to_owned(),
    };
    let notice = |text: &str, picture: Option<&str>| HostReport::Notify {
        text: text.to_owned(),
        picture: picture.map(str::to_owned),
    };
    let expected = [
        entry("moved", r#"{"energy":3.5,"where":"door"}"#),
        entry("seen", "{}"),
        notice("hello", None),
        notice("look", Some("a.jpg")),
    ];
    assert_eq!(rig.reports, expected);
}

#[test]
fn invalid_entries_and_messages_are_refused_with_a_message() {
    for (call, words) in [
        ("journal.add('')", "one word"),
        ("journal.add('two words')", "one word"),
        ("journal.add('moved', {1, 2})", "must have names"),
        (
            "journal.add('moved', {f = print})",
            "a function cannot be stored",
        ),
        (
            "journal.add('moved', {t = ('x'):rep(5000)})",
            "longer than 4096 bytes",
        ),
        ("notify.send(' ')", "the text is empty"),
        ("notify.send(('x'):rep(1001))", "1000"),
        (
            "notify.send('x', {picture = '/etc/passwd'})",
            "a path that frame:save returned",
        ),
        (
            "notify.send('x', {picture = '../b/1.jpg'})",
            "a path that frame:save returned",
        ),
        ("notify.send('x', {image = '1.jpg'})", "image"),
    ] {
        let rig = Rig::new(&format!("print(pcall(function() {call} end))"));
        let text = rig.texts().join("\n");
        assert!(
            text.starts_with("false") && text.contains(words),
            "{call}: {text}"
        );
        assert_eq!(rig.reports, []);
    }
}

#[test]
fn the_daily_limit_refills_evenly_and_false_means_that_it_is_used_up() {
    let source = "local function burst() local n = 0 while notify.send('x') do n += 1 end return n end
                  print(burst()) task.wait(3600) print(burst())
                  local kept = 0 while journal.add('k', {t = ('x'):rep(4000)}) do kept += 1 end print(kept)";
    let mut rig = Rig::new(source);
    rig.pass(Duration::from_secs(3601).as_secs_f64());
    let numbers: Vec<u32> = rig
        .texts()
        .iter()
        .map(|text| text.parse().unwrap())
        .collect();
    assert_eq!(numbers[0], 5, "a 24th of 120");
    assert!((4..=5).contains(&numbers[1]), "{numbers:?}");
    assert!((38..=44).contains(&numbers[2]), "{numbers:?}");
}
