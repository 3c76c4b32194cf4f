# Adds LAB_TRACE (events, poses, the world) and LAB_STDLIB (a folder of modules) to the long runs.
import re
def sub(f,a,b,n=1):
    s=open(f).read(); assert a in s,(f,a); open(f,'w').write(s.replace(a,b,n))
m='src/script/modules.rs'
sub(m,'''        .map(|(name, source)| Target::Library(name, source))
''','''        .map(|(name, source)| Target::Library(name, lab(name, source)))
''')
sub(m,'''#[derive(Debug, Clone)]
pub(super) enum Progress {''','''/// Lab.
pub fn lab(name: &str, source: &'static str) -> &'static str {
    let Ok(dir) = std::env::var("LAB_STDLIB") else { return source };
    let path = format!("{dir}/{}.luau", name.trim_start_matches("@spykee/"));
    match std::fs::read_to_string(path) {
        Ok(text) => Box::leak(text.into_boxed_str()),
        Err(_) => source,
    }
}

#[derive(Debug, Clone)]
pub(super) enum Progress {''')
sub('src/script/mod.rs','pub use modules::{ModuleFile,','pub use modules::{lab, ModuleFile,')
sub('src/agent/running_pilot.rs','(script::RESCUE.into(),','(script::lab("rescue", script::RESCUE).into(),')
r='tests/rescue/mod.rs'
sub(r,'''            count.lock().unwrap().count(&event)
''','''            count.lock().unwrap().count(&event);
            let wanted = matches!(event.kind, EventKind::Heard | EventKind::Said | EventKind::Safety | EventKind::Log);
            if std::env::var("LAB_TRACE").is_ok() && wanted && !event.text.starts_with("Move(") {
                println!("E {label} {:.2} {:?} {}", event.at.as_secs_f64(), event.kind, event.text);
            }
''')
sub(r,'''    let count = efforts.clone();
''','''    let count = efforts.clone();
    let label = start.seed;
''')
sub(r,'''            let _ = timeout(LIMIT, simulation.sim().wait_state(over)).await;
''','''            let trace = async {
                loop {
                    sleep(Duration::from_millis(500)).await;
                    let s = simulation.sim().state();
                    println!("P {label} {:.2} {:.3} {:.3} {:.4} {:.2}", simulation.now().as_secs_f64(), s.pose.x, s.pose.y, s.pose.heading, s.battery);
                }
            };
            if std::env::var("LAB_TRACE").is_ok() {
                tokio::select! { _ = timeout(LIMIT, simulation.sim().wait_state(over)) => {}, () = trace => {} }
            } else {
            let _ = timeout(LIMIT, simulation.sim().wait_state(over)).await;
            }
''')
sub(r,'''sleep(Duration::from_millis(500)).await;''','''sleep(Duration::from_millis(200)).await;''')
sub(r,'''    let label = start.seed;
''','''    let label = start.seed;
    if std::env::var("LAB_TRACE").is_ok() {
        let w = &place.world;
        println!("Y {label} {:?} || {:?} || {:?} || {:?} || {:?} || {:?}", w.room, w.walls, w.furniture, w.station, w.walkers, w.posts);
    }
''')
