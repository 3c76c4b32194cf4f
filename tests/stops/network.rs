//! A network between an agent and a robot that can lose every packet: three network namespaces, of
//! which the middle one forwards.

use std::fs::File;
use std::process::{Command as Process, Output};
use std::sync::atomic::{AtomicU32, Ordering};

/// The robot's address in the network.
pub const ROBOT: &str = "10.9.0.1:9000";

/// Makes the namespaces `$N-robot`, `$N-relay` and `$N-agent`.
const SET_UP: &str = "set -e
for ns in robot relay agent; do ip netns add $N-$ns; ip -n $N-$ns link set lo up; done
ip link add r0 netns $N-robot type veth peer name r1 netns $N-relay
ip link add a0 netns $N-agent type veth peer name a1 netns $N-relay
ip -n $N-robot addr add 10.9.0.1/24 dev r0
ip -n $N-relay addr add 10.9.0.2/24 dev r1
ip -n $N-relay addr add 10.9.1.2/24 dev a1
ip -n $N-agent addr add 10.9.1.1/24 dev a0
ip -n $N-robot link set r0 up
ip -n $N-relay link set r1 up
ip -n $N-relay link set a1 up
ip -n $N-agent link set a0 up
ip -n $N-robot route add default via 10.9.0.2
ip -n $N-agent route add default via 10.9.1.2
ip netns exec $N-relay sh -c 'echo 1 > /proc/sys/net/ipv4/ip_forward'";
const TEAR_DOWN: &str = "for ns in robot relay agent; do ip netns del $N-$ns; done";
/// Queues without any room, both ways.
const DROP: &str = "set -e
for device in r1 a1; do ip netns exec $N-relay tc qdisc add dev $device root pfifo limit 0; done";
const FORWARD: &str =
    "for device in r1 a1; do ip netns exec $N-relay tc qdisc del dev $device root; done";

/// The namespaces; deleted on drop.
pub struct Network(String);

impl Network {
    /// Fails, with the reason, if this process may not create namespaces.
    pub fn new() -> Result<Network, String> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let network = Network(format!("stops-{}-{count}", std::process::id()));
        succeeded(&network.shell(SET_UP))?;
        Ok(network)
    }

    /// The namespace of one end, `robot` or `agent`.
    pub fn namespace(&self, end: &str) -> File {
        File::open(format!("/run/netns/{}-{end}", self.0)).unwrap()
    }

    /// From now on no packet gets through.
    pub fn lose(&self) {
        succeeded(&self.shell(DROP)).unwrap();
    }

    /// Packets get through again.
    pub fn forward(&self) {
        succeeded(&self.shell(FORWARD)).unwrap();
    }

    fn shell(&self, script: &str) -> Output {
        let mut shell = Process::new("sh");
        shell.args(["-c", script]).env("N", &self.0);
        shell.output().unwrap()
    }
}

fn succeeded(output: &Output) -> Result<(), String> {
    if output.status.success() {
        return Ok(());
    }
    Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
}

impl Drop for Network {
    fn drop(&mut self) {
        self.shell(TEAR_DOWN);
    }
}
