//! Definition and serialisation of colours.

use super::*;

#[test]
fn pure_colours_have_one_name_each() {
    let pure = [
        ("red", [255, 0, 0]),
        ("orange", [255, 128, 0]),
        ("yellow", [255, 255, 0]),
        ("green", [0, 255, 0]),
        ("cyan", [0, 255, 255]),
        ("blue", [0, 0, 255]),
        ("magenta", [255, 0, 255]),
        ("white", [255, 255, 255]),
        ("black", [0, 0, 0]),
    ];
    for (name, rgb) in pure {
        let names: Vec<_> = Colour::NAMES
            .into_iter()
            .filter(|other| Colour::named(other).unwrap().contains(rgb))
            .collect();
        assert_eq!(names, [name], "{rgb:?}");
    }
    assert_eq!(Colour::named("mauve"), None);
}

#[test]
fn a_hue_may_wrap() {
    let red = Colour::hsv([340.0, 20.0], [50.0, 100.0], [30.0, 100.0]).unwrap();
    assert!(red.contains([255, 0, 40]) && red.contains([255, 40, 0]) && !red.contains([0, 255, 0]));
}

#[test]
fn impossible_ranges_are_refused_with_their_channel() {
    let refused = |colour: Result<Colour, ColourError>, says: &str| {
        let text = colour.unwrap_err().to_string();
        assert!(text.contains(says), "{text:?} does not say {says:?}");
    };
    refused(
        Colour::lab([70.0, 30.0], [0.0, 1.0], [0.0, 1.0]),
        "l = 70..30 is empty",
    );
    refused(
        Colour::lab([0.0, 100.0], [-129.0, 1.0], [0.0, 1.0]),
        "a = -129..1 must lie within -128..127",
    );
    refused(
        Colour::hsv([0.0, 361.0], [0.0, 1.0], [0.0, 1.0]),
        "h = 0..361",
    );
    refused(
        Colour::hsv([0.0, f64::NAN], [0.0, 1.0], [0.0, 1.0]),
        "h = 0..NaN",
    );
    refused(
        Colour::hsv([0.0, 360.0], [9.0, 1.0], [0.0, 1.0]),
        "s = 9..1 is empty",
    );
}

#[test]
fn a_config_holds_colours_by_channel() {
    let read = |text| serde_yaml::from_str::<Colour>(text);
    let ball = read("{ l: [30, 70], a: [20, 80], b: [10, 60] }").unwrap();
    assert_eq!(
        ball,
        Colour::lab([30.0, 70.0], [20.0, 80.0], [10.0, 60.0]).unwrap()
    );
    assert_eq!(
        read("h: [340, 20]").unwrap(),
        Colour::hsv([340.0, 20.0], [0.0, 100.0], [0.0, 100.0]).unwrap()
    );
    assert!(
        read("{ l: [30, 70], h: [0, 9] }")
            .unwrap_err()
            .to_string()
            .contains("not both")
    );
    assert!(
        read("{ hue: [0, 9] }")
            .unwrap_err()
            .to_string()
            .contains("unknown field `hue`")
    );
    assert!(
        read("{ l: [30, 170] }")
            .unwrap_err()
            .to_string()
            .contains("0..100")
    );
}

#[test]
fn a_colour_survives_every_serialisation() {
    for colour in [
        Colour::named("red").unwrap(),
        Colour::lab([0.5, 7.0], [-20.0, 8.0], [1.0, 6.0]).unwrap(),
    ] {
        let compact = postcard::to_allocvec(&colour).unwrap();
        assert_eq!(postcard::from_bytes::<Colour>(&compact).unwrap(), colour);
        assert_eq!(
            serde_yaml::from_str::<Colour>(&serde_yaml::to_string(&colour).unwrap()).unwrap(),
            colour
        );
        assert_eq!(
            serde_yaml::from_str::<Colour>(&colour.to_string()).unwrap(),
            colour
        );
    }
}
