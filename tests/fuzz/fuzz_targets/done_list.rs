//! The file of `batch --done`, and the same file with a further line.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview_common::records::done_list::DoneList;

fuzz_target!(|bytes: &[u8]| match DoneList::parse(bytes) {
    Ok(list) => {
        let complete = &bytes[..list.complete_bytes];
        assert!(list.complete_bytes == 0 || complete.ends_with(b"\n") || complete == b"\xef\xbb\xbf", "{list:?}");
        let line = b"{\"command\":[\"a\"],\"line\":1,\"result\":{\"targets\":[{\"files\":[\"b\"]}],\"video\":\"c\"}}\n";
        let again = DoneList::parse(&[complete, line].concat()).unwrap();
        assert_eq!(again.rendered[&vec!["a".to_owned()]], ["b", "c"]);
        assert_eq!(again.complete_bytes, complete.len() + line.len());
        assert!(list.rendered.keys().all(|command| again.rendered.contains_key(command)));
    }
    Err(error) => assert!(error.to_string().contains("expected a file of an earlier run"), "{error}"),
});
