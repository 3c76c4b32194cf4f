use std::time::Duration;

use super::*;

#[test]
fn plain_data_is_restored_unchanged() {
    let source = "store.set('a', {list = {1, 2.5, -0.1}, text = 'ä\"\\n', on = true, deep = {{{}}}}) store.set('n', 0.1 + 0.2)
                  print(store.get('b', 'none'), table.concat(store.keys(), ','))";
    let mut rig = Rig::new(source);
    assert_eq!(rig.texts(), ["none a,n"]);
    let file = rig.script.take_store().unwrap();
    assert!(!rig.script.has_store_changed());
    let mut again = Rig::loaded(
        "local a = store.get('a') print(a.list[3], #a.list, a.text == 'ä\"\\n', a.on, #a.deep, store.get('n') == 0.1 + 0.2)
         print(store.delete('a'), store.delete('a'), store.get('a'), #store.keys())",
        |_| {},
    );
    again.script.restore(&file).unwrap();
    again.run();
    assert_eq!(
        again.texts(),
        ["-0.1 3 true true 1 true", "true false nil 1"]
    );
}

#[test]
fn other_values_than_plain_data_are_refused_with_a_message() {
    for (value, words) in cases(
        r"print => a function cannot be stored
          0/0 => must be finite
          math.huge => must be finite
          '\xff' => must be UTF-8
          {1, nil, 3} => without gaps
          {1, a = 2} => without gaps
          {[2.5] = 1} => only strings as keys
          (function() local t = {} t.t = t return t end)() => contains itself
          nil => store.delete
          ('x'):rep(1.2e6) => longer than 1048576 bytes
          table.create(30000, 1) => at most 20000 values
          (function() local t = {} for _ = 1, 6 do t = {t, t, t, t, t, t, t, t} end return t end)() => at most 20000 values",
    ) {
        let text = failure(&format!("store.set('key', {value})"));
        assert!(text.contains(words), "{value}: {text}");
    }
}

#[test]
fn a_full_store_is_a_clear_error_and_keeps_its_values() {
    let rig = Rig::new(
        "local ok, e
         for i = 1, 100 do ok, e = pcall(store.set, 'k' .. i, ('x'):rep(50000)) if not ok then print(i, e) break end end
         print(#store.get('k1'), #store.keys()) store.delete('k1') store.set('small', 1) print(store.get('small'))",
    );
    let texts = rig.texts();
    assert!(
        texts[0].starts_with("21 test.lua:2: store.set: the store is full: it may hold 1 MiB"),
        "{texts:?}"
    );
    assert_eq!(texts[1..], ["50000 20", "1"]);
}

#[test]
fn a_damaged_file_is_refused_and_leaves_the_store_as_it_was() {
    for wrong in [&b"{ \"a\": 1"[..], b"", b"[1]", b"\xff", b"{\"a\": 1} x"] {
        let mut rig = Rig::loaded("print(#store.keys())", |_| {});
        assert!(rig.script.restore(wrong).is_err());
        rig.run();
        assert_eq!(rig.texts(), ["0"]);
    }
}

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
    for (call, words) in cases(
        "journal.add('') => one word
         journal.add('two words') => one word
         journal.add('moved', {1, 2}) => must have names
         journal.add('moved', {f = print}) => a function cannot be stored
         journal.add('moved', {t = ('x'):rep(5000)}) => longer than 4096 bytes
         notify.send(' ') => the text is empty
         notify.send(('x'):rep(1001)) => 1000
         notify.send('x', {picture = '/etc/passwd'}) => a path that frame:save returned
         notify.send('x', {picture = '../b/1.jpg'}) => a path that frame:save returned
         notify.send('x', {image = '1.jpg'}) => image",
    ) {
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
