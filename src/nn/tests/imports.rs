//! State dicts that are not what they should be. Those that are good are in `tests/suite/policies.rs`.

use super::*;
use crate::base::error::Error;
use crate::nn::state_dict::StateDict;
use proptest::prelude::*;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/import").join(name)
}

fn read(bytes: &[u8]) -> crate::base::error::Result<StateDict> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("agent.th");
    std::fs::write(&path, bytes).unwrap();
    StateDict::read(&path)
}

#[track_caller]
fn failed(bytes: &[u8], words: &str) {
    let error = read(bytes).unwrap_err();
    let named = error.to_string().contains("agent.th");
    assert!(!matches!(error, Error::Usage(_)) && named && error.to_string().contains(words), "{error:?}");
}

/// An archive with this pickle and one file of values.
fn archive(pickle: &[u8]) -> Vec<u8> {
    entries(&[("agent/data.pkl", pickle), ("agent/data/0", &[0; 64])])
}

fn entries(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in entries {
        let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file(*name, stored).unwrap();
        archive.write_all(content).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// The pickle of `{name: _rebuild_tensor_v2(*arguments)}`.
fn pickle(arguments: &[u8]) -> Vec<u8> {
    [b"\x80\x02}X\x01\x00\x00\x00wctorch._utils\n_rebuild_tensor_v2\n(", arguments, b"tRs."].concat()
}

/// The arguments for a tensor of this shape, given as opcodes, in file 0.
fn tensor(class: &str, size: &[u8], stride: &[u8]) -> Vec<u8> {
    let storage = format!(
        "(X\x07\x00\x00\x00storagectorch\n{class}\nX\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x04tQK\x00"
    );
    pickle(&[storage.as_bytes(), b"(", size, b"t(", stride, b"t\x89)R"].concat())
}

#[test]
fn no_file() {
    for path in ["/", "", "/no/such/file", "/dev/null"] {
        let error = StateDict::read(Path::new(path)).unwrap_err();
        assert!(matches!(error, Error::Usage(_)), "{error:?}");
    }
}

#[test]
fn no_archive() {
    failed(b"", "not a PyTorch state dict");
    failed(b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.", "saved by PyTorch before 1.6");
    failed(&[0; 4096], "not a PyTorch state dict");
    failed(b"PK\x03\x04", "not a PyTorch state dict");
}

#[test]
fn truncated() {
    let good = std::fs::read(data("gru-shared.th")).unwrap();
    read(&good).unwrap();
    for length in (0..good.len()).step_by(97) {
        failed(&good[..length], "");
    }
}

#[test]
fn a_pickle_is_missing_or_one_too_many() {
    failed(&entries(&[("agent/data/0", &[0; 64])]), "0 files data.pkl");
    failed(&entries(&[("a/data.pkl", b"}."), ("b/data.pkl", b"}.")]), "2 files data.pkl");
    failed(&entries(&[]), "0 files data.pkl");
}

#[test]
fn pickles_that_make_no_sense() {
    for pickle in [&b""[..], b".", b"\x80\x02", b"t.", b"0.", b"X\xff\xff\xff\xffa.", b"K\x01."] {
        let _ = read(&archive(pickle));
    }
    failed(&archive(&[b'N'; (1 << 17) + 1]), "expected at most");
    // Objects nested as deep as a pickle may be long.
    let _ = read(&archive(&[&[b')'][..], &[0x85; (1 << 17) - 2], b"."].concat()));
    failed(&archive(&pickle(b"")), "makes no sense");
    failed(&archive(&pickle(b"K\x00K\x00K\x00K\x00")), "makes no sense");
    // What is no tensor is missing later.
    assert!(!read(&archive(b"}X\x01\x00\x00\x00wK\x01s.")).unwrap().has("w"));
}

#[test]
fn tensors_that_are_not_in_the_file() {
    assert!(read(&archive(&tensor("FloatStorage", b"K\x04", b"K\x01"))).unwrap().has("w"));
    failed(&archive(&tensor("FloatStorage", b"K\x11", b"K\x01")), "");
    let huge = b"J\xff\xff\xff\x7fJ\xff\xff\xff\x7fJ\xff\xff\xff\x7f";
    failed(&archive(&tensor("FloatStorage", huge, b"K\x01K\x01K\x01")), "larger than the file");
    failed(&archive(&tensor("FloatStorage", b"K\x02K\x02", b"K\x03K\x0e")), "larger than the file");
}

fn import_with(dims: &Dims, actors: &str, predictor: &str) -> crate::base::error::Result<Policy> {
    let predictors = [("value-aware".to_string(), data(predictor))];
    import(&data(actors), &predictors, dims, Meta::new("toy", 0))
}

#[test]
fn state_dicts_for_something_else() {
    let check = |dims: Dims, actors: &str, predictor: &str, words: &str| {
        let error = import_with(&dims, actors, predictor).unwrap_err();
        assert!(!matches!(error, Error::Usage(_)) && error.to_string().contains(words), "{error:?}");
    };
    let (mlp, gru, network) = ("mlp-separate.th", "gru-shared.th", "network.th");
    import_with(&dims(), mlp, network).unwrap();
    import_with(&dims(), gru, network).unwrap();
    check(
        dims(),
        network,
        network,
        "network.th: it holds no actors: neither fc1.bias, if all agents share one, nor agents.0.fc1.bias",
    );
    check(dims(), mlp, gru, "gru-shared.th: tensor linear_1.bias is missing");
    let few = Dims { n_agents: 2, ..dims() };
    check(few.clone(), mlp, network, "mlp-separate.th: unexpected tensor agents.2.");
    check(
        few,
        gru,
        network,
        "tensor fc1.weight is [4, 10], expected [4, 9], [outputs, inputs], which a policy file keeps as [9, 4], [inputs, outputs]",
    );
    check(Dims { n_agents: 4, ..dims() }, mlp, network, "tensor agents.3.fc1.weight is missing");
    check(Dims { joint: 8, ..dims() }, mlp, network, "fc1.weight is [4, 7], expected [4, 8]");
    check(Dims { predicted: 7, ..dims() }, mlp, network, "linear_obs.weight is [12, 3], expected [14, 3]");
    check(Dims { n_actions: 3, ..dims() }, mlp, network, "fc2.weight is [5, 4], expected [3, 4]");
    // Ten inputs of an actor are three ids and seven values, or six ids and four.
    let narrow = Dims { n_agents: 6, joint: 4, predicted: 4, ..dims() };
    check(
        narrow,
        gru,
        network,
        "network.th: this predictor sees 7 values, but the joint estimate of toy has 4",
    );
}

#[test]
fn values_that_are_no_numbers() {
    let nan = f32::NAN.to_le_bytes().repeat(4);
    let pickle = tensor("FloatStorage", b"K\x04", b"K\x01");
    let mut dict = read(&entries(&[("agent/data.pkl", &pickle), ("agent/data/0", &nan)])).unwrap();
    let error = dict.take("w", &[4]).unwrap_err().to_string();
    assert!(error.contains("tensor w holds NaN"), "{error}");

    let mut dict = read(&archive(&tensor("DoubleStorage", b"K\x04", b"K\x01"))).unwrap();
    let error = dict.take("w", &[4]).unwrap_err().to_string();
    assert!(error.contains("tensor w is a DoubleStorage, expected a FloatStorage"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_changed_byte_is_no_panic(at in any::<proptest::sample::Index>(), byte in any::<u8>()) {
        let mut bytes = std::fs::read(data("gru-shared.th")).unwrap();
        let at = at.index(bytes.len());
        bytes[at] = byte;
        let _ = read(&bytes);
    }

    #[test]
    fn random_bytes_are_no_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(read(&bytes).is_err());
        let _ = read(&archive(&bytes));
    }
}
