//! The generated flats, in which rates are counted, are what they promise to be.

use spykee::sim::StationDistances;

use crate::flats::flat;

#[test]
fn the_robot_can_start_in_every_flat_and_get_to_its_station_and_into_every_room() {
    let mut rooms = [0; 6];
    for seed in 1..=60 {
        let flat = flat(seed);
        // Reading the document checks that start and station are free and inside.
        let distances = StationDistances::new(&flat.world);
        let start = flat.world.start_pose().point();
        assert!(distances.has_room(start), "seed {seed}: {start:?}");
        assert!(distances.length(start).is_some(), "seed {seed}: {start:?}");
        for place in &flat.places {
            assert!(distances.length(*place).is_some(), "seed {seed}: {place:?}");
        }
        rooms[flat.places.len()] += 1;
    }
    assert!(
        rooms[..2] == [0, 0] && rooms[2..].iter().all(|count| *count > 5),
        "{rooms:?}"
    );
}

#[test]
fn the_same_seed_gives_the_same_flat_and_another_seed_another_one() {
    assert_eq!(flat(7).yaml, flat(7).yaml);
    assert_ne!(flat(7).yaml, flat(8).yaml);
}
