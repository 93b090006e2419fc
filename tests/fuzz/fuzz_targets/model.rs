//! A model's metadata, and the shapes of its input and output. The fuzzer's text has a line
//! `key=value` for each metadata entry, and `hwv=` and `logits=` with sizes separated by spaces.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let entry = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('=')).map(str::to_owned);
    let shape = |name: &str| -> Vec<i64> {
        entry(name).iter().flat_map(|sizes| sizes.split(' ')).filter_map(|size| size.parse().ok()).collect()
    };
    match liveview::fuzz::model(entry, ("hwv", &shape("hwv")), ("logits", &shape("logits"))) {
        Ok(card) => {
            assert!((2..=64).contains(&card.views));
            assert_eq!(shape("hwv"), [-1, 3 * card.views as i64, -1, -1]);
        }
        Err(error) => assert!(error.to_string().starts_with("model.onnx: "), "{error}"),
    }
});
