use super::*;

/// Runs a script for this long.
fn lasting(seconds: f64, source: &str) -> Rig {
    let mut rig = Rig::new(source);
    rig.pass(seconds);
    rig
}

#[test]
fn every_module_loads_and_begins_with_its_description() {
    for (name, source) in crate::script::modules::BUILT_IN {
        assert!(source.starts_with(&format!("-- {name}: ")), "{name}");
        assert_eq!(printed(&format!("print(type(require('{name}')))")), "table");
        let text = failure(&format!("require('{name}').nothing()"));
        assert!(
            text.starts_with("test.lua:1: ") && text.contains("does not exist"),
            "{text}"
        );
    }
}

#[test]
fn pid_follows_its_formula_and_does_not_wind_up() {
    let rig = lasting(
        30.0,
        "local pid = require('@spykee/pid')
         local c = pid.new{ kp = 2, ki = 1, kd = 0.5, min = -10, max = 10, setpoint = 1 }
         print(c:update(0)) task.wait(1) print(c:update(0)) task.wait(1) print(c:update(0.5))
         c:reset() print(c:update(1))
         -- A second at the limit does not pile up.
         c:update(-100) for _ = 1, 5 do task.wait(1) c:update(-100) end
         task.wait(1) c:reset() print(c:update(1))
         local w = pid.new{ ki = 1, max = 2, setpoint = 1 }
         for _ = 1, 10 do w:update(0) task.wait(1) end
         print(w:update(0)) task.wait(1) print(w:update(1.5))",
    );
    // 2*1; + 1*1s; 2*0.5 + (1 + 0.5) - 0.5*0.5
    assert_eq!(rig.texts(), ["2", "3", "2.25", "0", "0", "2", "1.5"]);
    assert!(
        failure("require('@spykee/pid').new{kp = 'x'}").contains("pid.new: kp must be a number")
    );
    assert!(failure("require('@spykee/pid').new{pk = 1}").contains("unknown option 'pk'"));
}

#[test]
fn fsm_states_enter_work_exit_and_react_to_events_and_timeouts() {
    let mut rig = Rig::new(
        "local fsm = require('@spykee/fsm')
         local function noisy(name, more)
             more.enter = function() print('enter', name) end
             more.exit = function() print('exit', name) end
             return more
         end
         print('end', fsm.new{ initial = 'a', states = {
             a = noisy('a', { task = function() task.wait(1) return 'b' end }),
             b = noisy('b', { timeout = {2, 'c'}, task = function() local _, e = pcall(task.wait, 99) print('cut', e) end }),
             c = noisy('c', { on = { docked = function(m) return 'd' end } }),
             d = noisy('d', { task = function(m) m:stop() task.wait(9) end }),
         } }:run())",
    );
    rig.pass(5.0);
    assert_eq!(
        rig.texts(),
        [
            "enter a",
            "exit a",
            "enter b",
            "cut test.lua:9: cancelled",
            "exit b",
            "enter c"
        ]
    );
    rig.deliver(Event::Docked);
    rig.pass(1.0);
    assert_eq!(rig.texts()[6..], ["exit c", "enter d", "exit d", "end d"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn exit_always_runs_and_nothing_is_entered_after_a_stop() {
    let machine = "local fsm = require('@spykee/fsm')
         local m = fsm.new{ initial = 'a', states = {
             a = { enter = function() print('enter a') WHAT end, exit = function() print('exit a') end,
                   task = function(m) MORE task.wait(50) return 'b' end },
             b = { enter = function() print('enter b') end } } } ";
    let with = |what: &str, more: &str, rest: &str| {
        let source = machine.replace("WHAT", what).replace("MORE", more);
        lasting(1.0, &format!("{source} {rest}"))
    };
    let rig = with("error('oops')", "", "m:run()");
    assert_eq!(rig.texts(), ["enter a", "exit a"]);
    rig.assert_ended(EndReason::Error, "test.lua:3: oops");
    let rig = with("", "error('ouch')", "m:run()");
    rig.assert_ended(EndReason::Error, "test.lua:4: ouch");
    assert_eq!(rig.texts(), ["enter a", "exit a"]);
    let rig = with(
        "",
        "",
        "local t = task.spawn(function() m:run() end) task.wait(0.5) t:cancel()",
    );
    assert_eq!(rig.texts(), ["enter a", "exit a"]);
    let mut rig = with("", "", "m:run()");
    rig.script.stop(EndReason::Shutdown, rig.now);
    rig.run();
    assert_eq!(rig.texts(), ["enter a", "exit a"]);
    rig.assert_ended(EndReason::Shutdown, "");
    let rig = with("", "m:go('b') m:stop()", "m:run()");
    assert_eq!(rig.texts(), ["enter a", "exit a"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn fsm_names_states_that_do_not_exist() {
    for (states, words) in cases(
        "a = {timeout = {1, 'bb'}}, b = {} => there is no state 'bb' (states: a, b)
         a = {on = {docked = 'c'}} => there is no state 'c'
         a = {entre = print} => unknown key 'entre'
         a = {task = function() return 'x' end} => there is no state 'x'
         b = {} => initial: there is no state 'a'
         a = {on = {dockd = 'a'}} => state a: on: event.dockd does not exist; did you mean 'docked'?",
    ) {
        let text = failure(&format!(
            "require('@spykee/fsm').new({{initial = 'a', states = {{{states}}}}}):run()"
        ));
        assert!(text.contains(words), "{text}");
    }
}

#[test]
fn trees_return_the_results_of_their_nodes() {
    let text = lasting(
        100.0,
        "local bt = require('@spykee/bt')
         local n = 0
         local function yes() n += 1 return true end
         local function no() n += 1 return false end
         local function slow(ok) return function() task.wait(1) return ok end end
         local function try(node) n = 0 local at = task.now() local ok = bt.run(node) print(ok, n, task.now() - at) end
         try(bt.sequence(yes, yes, no, yes))
         try(bt.fallback(no, no, yes, no))
         try(bt.invert(no)) try(bt.succeed(no)) try(bt.fail(yes))
         try(bt.retry(3, no)) try(bt.loop(3, yes))
         try(bt.timeout(0.5, slow(true))) try(bt.timeout(5, slow(true)))
         try(bt.parallel({}, slow(true), slow(true)))
         try(bt.parallel({succeed = 1}, slow(true), function() task.wait(50) return true end))
         try(bt.parallel({}, slow(false), function() task.wait(50) return true end))
         try(bt.parallel({succeed = 2, fail = 3}, slow(true), slow(false), slow(false)))",
    );
    assert_eq!(
        text.texts(),
        [
            "false 3 0",
            "true 3 0",
            "true 1 0",
            "true 1 0",
            "false 1 0",
            "false 3 0",
            "true 3 0",
            "false 0 0.5",
            "true 0 1",
            "true 0 1",
            "true 0 1",
            "false 0 1",
            "false 0 1"
        ]
    );
    assert!(
        failure("local bt = require('@spykee/bt') bt.run(function() end)")
            .contains("must return true or false, got nothing")
    );
}

#[test]
fn machines_and_trees_log_their_transitions() {
    let mut rig = Rig::new(
        "local fsm = require('@spykee/fsm')
         fsm.new{ initial = 'a', states = {
             a = { task = function() task.wait(1) return 'b' end },
             b = { timeout = {2, 'c'} },
             c = { on = { docked = 'd' } },
             d = { task = function(m) m:stop() end },
         } }:run()",
    );
    rig.pass(5.0);
    rig.deliver(Event::Docked);
    rig.pass(1.0);
    assert_eq!(
        rig.logged(Level::Debug),
        [
            "fsm: begins in a",
            "fsm: a -> b (its task)",
            "fsm: b -> c (timeout of 2 s)",
            "fsm: c -> d (on docked)",
            "fsm: d is the last state (machine:stop)",
        ]
    );
    let rig = lasting(
        5.0,
        "local bt = require('@spykee/bt')
         local good = 1
         local function is_good() return good > 0 end
         local tree = bt.fallback(is_good, bt.name('the last way', function() return true end))
         for _ = 1, 3 do bt.run(tree) end
         good = 0
         bt.run(tree)",
    );
    assert_eq!(
        rig.logged(Level::Debug),
        [
            "bt: is_good has succeeded",
            "bt: fallback has succeeded",
            "bt: is_good has failed",
            "bt: the last way has succeeded",
        ]
    );
}

#[test]
fn an_error_in_a_tree_names_the_node() {
    for (nodes, words) in cases(
        "local function drive() error('ouch') end bt.run(bt.sequence(bt.retry(2, drive))) => test.lua:1: ouch (in the node drive)
         bt.run(bt.fallback(bt.name('look', function() error('ouch') end))) => ouch (in the node look)
         bt.run(bt.timeout(3, bt.action{run = function() error('ouch') end, halt = function() end})) => ouch (in the node of line 1)
         local function drive() return 1 end bt.run(bt.parallel({}, drive)) => bt: the node drive must return true or false, got number",
    ) {
        let text = failure(&format!("local bt = require('@spykee/bt') {nodes}"));
        assert!(text.contains(words), "{text}");
        assert!(text.matches("(in the node").count() <= 1, "{text}");
    }
}

#[test]
fn a_guard_halts_a_node_whose_condition_does_not_hold_any_more() {
    let rig = lasting(
        20.0,
        "local bt = require('@spykee/bt')
         local full = true
         local function has_power() return full end
         local work = bt.action{ run = function() task.wait(9) return true end, halt = function() print('halt', task.now()) end }
         task.delay(2.05, function() full = false end)
         print(bt.run(bt.guard(has_power, work)), task.now())
         print(bt.run(bt.guard(has_power, work)), task.now())
         full = true
         print(bt.run(bt.guard(has_power, bt.timeout(1, work), 0.5)), task.now())
         print(bt.run(bt.guard(has_power, function() return true end)))",
    );
    assert_eq!(
        rig.texts(),
        [
            "halt 2.1",
            "false 2.1",
            "false 2.1",
            "halt 3.1",
            "false 3.1",
            "true"
        ]
    );
}

#[test]
fn nested_halts_are_awaited() {
    let rig = lasting(
        10.0,
        "local bt = require('@spykee/bt')
         local function leaf(name)
             return bt.action{ run = function() task.wait(99) return true end, halt = function() print('halt', name) robot.led('left', false) end }
         end
         local tree = bt.timeout(1, bt.parallel({}, leaf('a'), bt.parallel({}, leaf('b'), bt.sequence(leaf('c')))))
         print(bt.run(tree)) print('after')",
    );
    let mut halted = rig.texts()[..3].to_vec();
    halted.sort_unstable();
    assert_eq!(halted, ["halt a", "halt b", "halt c"]);
    assert_eq!(rig.texts()[3..], ["false", "after"]);
}

/// A room of 4 x 3 m with a doorway in its right wall, from y = 1 to 2, into a second room of the same
/// size; `scan(x, y, heading)` returns what the robot would see from there.
const TWO_ROOMS: &str = "
    local map = require('@spykee/map')
    local walls = {
        { 0, 0, 0, 3 }, { 0, 0, 8, 0 }, { 0, 3, 8, 3 }, { 8, 0, 8, 3 }, { 4, 0, 4, 1 }, { 4, 2, 4, 3 },
    }
    local function distance(x, y, angle)
        local dx, dy, least = math.cos(angle), math.sin(angle), 9
        for _, w in walls do
            local away = if w[1] == w[3] then (w[1] - x) / dx else (w[2] - y) / dy
            local along = if w[1] == w[3] then y + away * dy else x + away * dx
            local from, to = if w[1] == w[3] then w[2] else w[1], if w[1] == w[3] then w[4] else w[3]
            if away > 0 and along >= from and along <= to then
                least = math.min(least, away)
            end
        end
        return least
    end
    local function scan(x, y, heading)
        local rays = {}
        for number = 0, 119 do
            local angle = number * math.pi / 60
            local away = distance(x, y, heading + angle)
            table.insert(rays, { angle = angle, distance = away, known = true, low = away, nearest = 0.5 })
        end
        return rays
    end
    local function enter(x, y, heading)
        local pose = { x = x, y = y, heading = heading }
        map.enter(pose, scan(x, y, heading), 1)
        map.stand(pose)
        map.search(pose)
        return pose
    end
";

#[test]
fn the_way_on_the_map_leads_through_the_doorway_until_that_is_given_up() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             local pose = enter(2, 1.5, 1)
             local way = map.way(pose)
             print(math.abs(way.heading) < 0.3, way.distance > 1.5)
             map.give_up(way.target)
             local other = map.way(pose)
             print(other == nil or other.target ~= way.target)
             for _ = 1, 10 do -- the places in front of the doorway and in it
                 if other and math.abs(other.heading) <= 0.5 then
                     map.give_up(other.target)
                     other = map.way(pose)
                 end
             end
             print(other == nil or math.abs(other.heading) > 0.5)
             map.doubt()
             print(map.way(pose).target == way.target)
             map.forget()
             print(map.way(pose))"
        ),
    );
    assert_eq!(rig.texts(), ["true true", "true", "true", "true", "nil"]);
}

#[test]
fn neither_a_way_nor_sight_leads_through_a_gap_in_a_wall_that_was_seen_inexactly() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             local pose = enter(2, 1.5, 0)
             enter(6, 1.5, 0)
             local through = {{ angle = math.pi, distance = 2.9, known = true, low = 2.9, nearest = 0.5 }} -- the wall: 2 m
             map.enter({{ x = 2, y = 1.55, heading = 0 }}, {{ through }}, 4)
             print(map.is_worth_a_search({{ x = 0.5, y = 1.55, heading = 0 }}))
             print(map.way(pose).distance < 1.5)"
        ),
    );
    assert_eq!(rig.texts(), ["false", "true"]);
}

#[test]
fn what_searches_have_shown_is_no_place_for_the_next_one() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             local pose = enter(2, 1.5, 0)
             local doorway = {{ x = 4, y = 1.5, heading = 0 }}
             print(map.is_worth_a_search(pose), map.is_worth_a_search(doorway))
             enter(6, 1.5, 0)
             print(map.is_worth_a_search(doorway))"
        ),
    );
    assert_eq!(rig.texts(), ["false true", "false"]);
}

#[test]
fn what_hides_the_floor_does_not_replace_on_the_map_what_was_seen_before() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             enter(2, 1.5, 0)
             local ahead = {{ x = 1, y = 1.5, heading = math.pi }}
             local hidden = map.rays({{ {{ bearing = 0, depth = 0, away = 0, known = false, nearest = 1 }} }})
             map.enter(ahead, hidden, 1)
             print(map.obstacle_ahead(ahead) > 0.7)
             local unseen = {{ x = 11, y = 1.5, heading = math.pi }}
             map.enter(unseen, hidden, 1)
             print(map.obstacle_ahead(unseen) < 0.7)"
        ),
    );
    assert_eq!(rig.texts(), ["true", "true"]);
}

#[test]
fn something_low_is_no_wall_and_what_is_behind_it_replaces_nothing_that_was_seen() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             local function enter_over_something_low(pose, wall)
                 local low = {{ bearing = 0, depth = 1, away = 1, wall = wall, known = true, nearest = 0.9 }}
                 map.enter(pose, map.rays({{ low }}), 1)
             end
             enter_over_something_low({{ x = 11, y = 1.5, heading = 0 }}, 2.5)
             print(map.obstacle_ahead({{ x = 11.5, y = 1.5, heading = 0 }})) -- where something low is
             print(map.obstacle_ahead({{ x = 12.6, y = 1.5, heading = 0 }}) < 1.1) -- the wall
             enter(1, 1.5, 0)
             enter_over_something_low({{ x = 2, y = 1.5, heading = math.pi }}, 3)
             print(map.obstacle_ahead({{ x = 1, y = 1.5, heading = math.pi }}) < 1.1)"
        ),
    );
    assert_eq!(rig.texts(), ["nil", "true", "true"]);
}

#[test]
fn a_scan_tells_the_direction_of_the_walls() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             local function off(x, y, heading)
                 return math.abs(math.deg(map.walls(scan(x, y, heading)) + heading))
             end
             print(off(1, 1, 0) < 2, off(1.2, 0.9, math.rad(9)) < 2, off(2, 1.5, math.rad(-30)) < 2)
             local round = {{}}
             for bin = 0, 119 do
                 table.insert(round, {{ angle = bin * math.pi / 60, distance = 2, known = true }})
             end
             print(map.walls(round), map.walls({{}}))"
        ),
    );
    assert_eq!(rig.texts(), ["true true true", "nil nil"]);
}

#[test]
fn a_scan_tells_the_place_of_a_robot_that_is_believed_up_to_a_metre_aside() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             print(map.match({{ x = 1, y = 2, heading = 0 }}, scan(1, 2, 0))) -- nothing is known yet
             enter(2, 1.5, 0)
             local function off(x, y, heading, off_x, off_y)
                 local believed = {{ x = x + off_x, y = y + off_y, heading = heading }}
                 local at_x, at_y = map.match(believed, scan(x, y, heading))
                 return math.max(math.abs(at_x - x), math.abs(at_y - y))
             end
             print(off(1.2, 1, 0.3, 0, 0) < 0.12, off(1.2, 1, 0.3, 0.5, -0.4) < 0.12)
             print(off(2.7, 1.8, 2, -0.7, 0.3) < 0.12, off(1.2, 1, 0.3, 2, 0) > 0.9) -- too far aside
             print(map.match({{ x = 1, y = 2, heading = 0 }}, {{}}))"
        ),
    );
    assert_eq!(rig.texts(), ["1 2", "true true", "true true", "1 2"]);
}

#[test]
fn a_scan_does_not_fit_where_its_rays_would_pass_through_a_wall() {
    let rig = lasting(
        1.0,
        "local map = require('@spykee/map')
         local function wall(distance)
             local rays = {}
             for angle = -0.5, 0.5, 0.05 do
                 local away = distance / math.cos(angle)
                 table.insert(rays, { angle = angle, distance = away, known = true, low = away, nearest = 0.5 })
             end
             return rays
         end
         map.enter({ x = 0, y = 0, heading = 0 }, wall(2), 1)
         map.enter({ x = 4.9, y = 0, heading = math.pi }, wall(2), 1) -- another one, 0.9 m behind it
         local x = map.match({ x = 0.6, y = 0, heading = 0 }, wall(2)) -- nearer to where it fits behind the first
         print(math.abs(x) < 0.15)",
    );
    assert_eq!(rig.texts(), ["true"]);
}

#[test]
fn what_a_column_recalls_is_not_entered_again() {
    let rig = lasting(
        1.0,
        "local whereabouts, map = require('@spykee/whereabouts'), require('@spykee/map')
         local column = { bearing = 0, depth = 0.7, away = 0.7, wall = 0.7, known = true, nearest = 1.3, recalled = true }
         whereabouts.see({ column })
         print(map.obstacle_ahead({ x = 0, y = 0, heading = 0 }))
         column.recalled = nil
         whereabouts.see({ column })
         print(map.obstacle_ahead({ x = 0, y = 0, heading = 0 }))",
    );
    let texts = rig.texts();
    assert_eq!(texts[0], "nil");
    assert!(
        (0.5..0.8).contains(&texts[1].parse().unwrap()),
        "{}",
        texts[1]
    );
}

#[test]
fn an_obstacle_blocks_the_way() {
    let rig = lasting(
        1.0,
        &format!(
            "{TWO_ROOMS}
             enter(1, 1, 0)
             local ahead = {{ x = 1, y = 1, heading = 0 }}
             print(map.obstacle_ahead(ahead))
             map.block(ahead)
             print(map.obstacle_ahead(ahead) < 0.3)"
        ),
    );
    assert_eq!(rig.texts(), ["nil", "true"]);
}

#[test]
fn the_compass_finds_the_period_of_an_even_turn_from_what_looks_the_same() {
    let rig = lasting(
        1.0,
        "local compass = require('@spykee/compass')
         local function views(period, measured, direction)
             local list = {}
             for number = 0, 200 do
                 local at = number * 0.1
                 local angle, profile = direction * 2 * math.pi * at / period, {}
                 for place = -18, 18 do
                     local there = angle + place * math.rad(1.5)
                     table.insert(profile, 0.5 + 0.2 * math.sin(3 * there) + 0.2 * math.sin(7 * there + 1))
                 end
                 table.insert(list, { at = at, turned = measured * angle, profile = profile })
             end
             return list
         end
         print(math.abs(compass.period(views(7.85, 1.09, 1)) - 7.85) < 0.05)
         print(math.abs(compass.period(views(7.85, 1.02, -1)) - 7.85) < 0.05)
         print(compass.period({}))",
    );
    assert_eq!(rig.texts(), ["true", "true", "nil"]);
}

#[test]
fn the_compass_does_not_count_the_dark_edges_of_pictures_once_it_has_learned_them() {
    let rig = lasting(
        1.0,
        "local compass = require('@spykee/compass')
         local function profile(turned)
             local list = {}
             for place = -14, 14 do
                 local there = turned + place * math.rad(1.5)
                 local bright = 0.5 + 0.02 * math.sin(3 * there) + 0.02 * math.sin(17 * there)
                 table.insert(list, bright * (1 - 0.3 * math.abs(place / 14) ^ 3))
             end
             return list
         end
         local function measured(turn)
             return (compass.turned(profile(1), profile(1 + turn), 0))
         end
         print(measured(0.1) < 0.05)
         compass.learn(table.create(29, 0)) -- a dark picture does no harm
         for degrees = 4, 720, 4 do compass.learn(profile(math.rad(degrees))) end
         print(math.abs(measured(0.1) - 0.1) < 0.01, math.abs(measured(-0.2) + 0.2) < 0.01)
         print(compass.turned({}, {}, 0))",
    );
    assert_eq!(rig.texts(), ["true", "true true", "0 1"]);
}

#[test]
fn a_robot_that_has_missed_a_part_of_a_turn_recognises_its_heading() {
    let rig = lasting(
        1.0,
        "local whereabouts = require('@spykee/whereabouts')
         local function profile(degrees)
             local list = {}
             for place = -14, 14 do
                 local there = math.rad(degrees + 1.5 * place)
                 table.insert(list, 0.5 + 0.2 * math.sin(3 * there) + 0.2 * math.sin(7 * there + 1))
             end
             return list
         end
         print(whereabouts.recognise(profile(0), math.pi))
         local views = {}
         for degrees = 0, 356, 4 do
             table.insert(views, { angle = math.rad(degrees), columns = {}, profile = profile(degrees) })
         end
         whereabouts.look(views)
         whereabouts.face(math.rad(450)) -- it has turned to 418 degrees
         print(whereabouts.recognise(profile(58), math.rad(12)))
         local heading = whereabouts.recognise(profile(58), math.rad(12 + 0.35 * 90))
         print(math.abs(math.deg(heading) - 418) < 1)
         print(whereabouts.recognise(table.create(29, 0.5), math.pi))",
    );
    assert_eq!(rig.texts(), ["nil", "nil", "true", "nil"]);
}

#[test]
fn the_compass_tells_coming_nearer_from_turning_on_the_spot() {
    let rig = lasting(
        1.0,
        "local compass = require('@spykee/compass')
         local function profile(size, turned, brightness)
             local list = {}
             for place = -14, 14 do
                 table.insert(list, brightness(place / size + turned))
             end
             return list
         end
         local function room(there) return 0.5 + 0.2 * math.sin(there / 2) + 0.1 * math.sin(there + 1) end
         local function wall(there) return 0.5 + 0.001 * (there * 7 % 3) end
         local function shows(size, turned, brightness)
             local larger, nearer = compass.growth(profile(1, 0, brightness), profile(size, turned, brightness))
             local says = function(number) return if number > 0.2 then '+' elseif number < -0.2 then '-' else '0' end
             return says(larger) .. says(nearer)
         end
         for _, turned in { -4.5, 0, 5.5 } do
             print(shows(1.12, turned, room), shows(1, turned, room), shows(1.02, turned, room))
         end
         print(shows(1.12, 0, wall), shows(1, 0, wall))
         print(compass.growth({}, {}))",
    );
    assert_eq!(
        rig.texts(),
        ["++ -0 -+", "++ -0 -+", "++ -0 -+", "00 00", "0 0"]
    );
}
