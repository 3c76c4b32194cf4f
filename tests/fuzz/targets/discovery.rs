//! Arbitrary datagrams as discovery replies: a parsed reply, emitted and parsed again, is the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use spykee::wire::discovery::{MAX_REPLY_LEN, REQUEST, Reply, is_request};

fuzz_target!(|datagram: &[u8]| {
    assert_eq!(is_request(datagram), datagram.starts_with(&REQUEST));
    let Some(reply) = Reply::parse(datagram) else {
        return;
    };
    assert!(!is_request(datagram), "both a request and a reply");
    let bytes = reply.emit();
    assert!(bytes.len() <= MAX_REPLY_LEN);
    if bytes.len() < MAX_REPLY_LEN {
        assert_eq!(Reply::parse(&bytes), Some(reply), "{bytes:?}");
    }
});
