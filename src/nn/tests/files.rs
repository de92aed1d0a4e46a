//! Files that are not what they should be: each is an error with words, none a panic.

use super::*;
use crate::base::error::Error;
use proptest::prelude::*;
use serde_json::{Map, Value, json};
use std::path::Path;

fn good() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    policy(ActorKind::Gru, Sharing::Separate).save(&path).unwrap();
    std::fs::read(path).unwrap()
}

fn open(bytes: &[u8]) -> Error {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    std::fs::write(&path, bytes).unwrap();
    let error = Policy::open(&path, &dims()).unwrap_err();
    assert!(error.to_string().contains(path.to_str().unwrap()), "names the file: {error}");
    error
}

/// The good file with a changed header and changed values.
fn changed(change: impl FnOnce(&mut Map<String, Value>, &mut Vec<u8>)) -> Vec<u8> {
    let bytes = good();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut header: Map<String, Value> = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    let mut values = bytes[8 + length..].to_vec();
    change(&mut header, &mut values);
    let header = Value::Object(header).to_string();
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &values].concat()
}

fn with_word(key: &'static str, value: Option<&'static str>) -> Vec<u8> {
    changed(|header, _| {
        let words = header["__metadata__"].as_object_mut().unwrap();
        match value {
            Some(value) => words.insert(key.to_string(), json!(value)),
            None => words.remove(key),
        };
    })
}

#[track_caller]
fn usage(bytes: &[u8], words: &str) {
    let error = open(bytes);
    assert!(matches!(error, Error::Usage(_)) && error.to_string().contains(words), "{error:?}");
}

#[track_caller]
fn failed(bytes: &[u8], words: &str) {
    let error = open(bytes);
    assert!(!matches!(error, Error::Usage(_)) && error.to_string().contains(words), "{error:?}");
}

#[test]
fn a_file_rewritten_by_somebody_else_opens() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    // Without padding the values lie anywhere.
    for pad in ["", " ", "  ", "   "] {
        let bytes = changed(|header, _| {
            header["__metadata__"]["note"] = json!(pad);
        });
        std::fs::write(&path, bytes).unwrap();
        let opened = Policy::open(&path, &dims()).unwrap();
        assert_eq!(bits(&values(&opened)), bits(&values(&policy(ActorKind::Gru, Sharing::Separate))));
    }
}

#[test]
fn no_file() {
    for path in ["/", "", "/no/such/file", "/dev/null"] {
        let error = Policy::open(Path::new(path), &dims()).unwrap_err();
        assert!(matches!(error, Error::Usage(_)), "{error:?}");
        assert!(matches!(PolicyFile::read(Path::new(path)), Err(Error::Usage(_))));
    }
}

#[test]
fn garbage() {
    failed(b"", "damaged");
    failed(b"PK\x03\x04", "damaged");
    failed(&[0; 4096], "damaged");
    failed(&[0xff; 4096], "damaged");
    for length in [u64::MAX, u64::MAX - 8, 1 << 40, 1 << 20, 99_999_999] {
        failed(&[&length.to_le_bytes()[..], b"{}"].concat(), "damaged");
    }
    let nested = "[".repeat(1 << 20);
    failed(&[&(nested.len() as u64).to_le_bytes()[..], nested.as_bytes()].concat(), "damaged");
}

#[test]
fn truncated() {
    let good = good();
    for length in (0..good.len()).step_by(61) {
        failed(&good[..length], "damaged");
    }
    failed(&[&good[..], b"more"].concat(), "damaged");
}

#[test]
fn no_policy() {
    let foreign = |metadata: &str| {
        let header = format!(r#"{{{metadata}"w":{{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}}}"#);
        [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &[0; 4]].concat()
    };
    usage(&foreign(""), "no policy");
    usage(&foreign(r#""__metadata__":{"format":"pt"},"#), "no policy");
    usage(&with_word("format", None), "no policy");
}

#[test]
fn another_version_or_task() {
    usage(&with_word("version", Some("2")), "version 2; this program reads version 1");
    usage(&with_word("task", Some("hear-see")), "for task hear-see, not for toy");
}

#[test]
fn metadata() {
    for key in ["version", "task", "algorithm", "actor", "sharing", "hidden", "steps", "seed", "origin"] {
        failed(&with_word(key, None), &format!("no `{key}`"));
    }
    failed(&with_word("steps", Some("-1")), r#""-1", expected a whole number"#);
    failed(&with_word("actor", Some("cnn")), "expected `mlp` or `gru`");
    failed(&with_word("sharing", Some("")), "expected `separate` or `shared`");
    failed(&with_word("hidden", Some("0")), "is 0, expected 1 to");
    failed(&with_word("hidden", Some("18446744073709551615")), "expected 1 to");
    failed(&with_word("hidden", Some("9")), "expected [7, 9]");
    failed(&with_word("predictors", Some("[")), "`predictors`");
    failed(&with_word("predictors", Some("[]")), "unexpected tensor predictors.");
    let predictor = r#"[{"name":"maro","inputs":"estimate","sigma":"softplus","held":[],"hidden":5}]"#;
    failed(&with_word("predictors", Some(predictor)), "expected `exp` or `soft-bounded`");
    let predictor = r#"[{"name":"maro","inputs":"estimate","sigma":"exp","held":[6],"hidden":5}]"#;
    failed(&with_word("predictors", Some(predictor)), "holds dim 6");
}

#[test]
fn tensors() {
    let name = "actors.1.gru.weight_hh";
    failed(&changed(|header, _| header[name]["shape"] = json!([24, 8])), "is [24, 8], expected [8, 24]");
    failed(&changed(|header, _| header[name]["dtype"] = json!("I32")), "is I32, expected F32");
    failed(&changed(|header, _| header[name]["dtype"] = json!("F16")), "damaged");
    failed(&changed(|header, _| header[name]["data_offsets"] = json!([0, 768])), "damaged");
    failed(&changed(|header, _| header[name]["shape"] = json!([1u64 << 62, 1u64 << 62])), "damaged");
    let renamed = changed(|header, _| {
        let tensor = header.remove(name).unwrap();
        header.insert("actors.3.gru.weight_hh".to_string(), tensor);
    });
    failed(&renamed, "unexpected tensor actors.3.gru.weight_hh");
    let removed = changed(|header, values| {
        let last = header.iter().filter(|(name, _)| *name != "__metadata__");
        let last = last.max_by_key(|(_, tensor)| tensor["data_offsets"][1].as_u64()).unwrap().0.clone();
        let tensor = header.remove(&last).unwrap();
        values.truncate(tensor["data_offsets"][0].as_u64().unwrap() as usize);
    });
    failed(&removed, "is missing");
    failed(&changed(|_, values| values[..4].copy_from_slice(&f32::NAN.to_le_bytes())), "holds NaN at 0");
}

#[test]
fn unwritable() {
    let folder = tempfile::tempdir().unwrap();
    let policy = policy(ActorKind::Mlp, Sharing::Separate);
    for path in [folder.path().join("no/such/folder/p"), folder.path().to_path_buf()] {
        let error = policy.save(&path).unwrap_err();
        assert!(matches!(&error, Error::File { what, .. } if what == "write"), "{error:?}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// What a changed byte in the header makes of a file is a policy or an error.
    #[test]
    fn a_changed_byte_is_no_panic(at in any::<proptest::sample::Index>(), byte in any::<u8>()) {
        let mut bytes = GOOD.clone();
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let at = at.index(8 + length);
        bytes[at] = byte;
        let _ = Policy::from_static(bytes.leak(), &dims());
    }
}

static GOOD: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(good);

/// A policy whose actors, and one of its predictors, have everything that they can have; the other is as in the paper.
fn with_everything() -> Policy {
    let mut networks = networks(ActorKind::Mlp, Sharing::Separate);
    networks.actor_inputs = vec![Input::Estimate, Input::Delivered, Input::Age];
    let inputs = vec![Input::Estimate, Input::OwnAction];
    let plain = networks.predictors[1].clone();
    networks.predictors[1] = PredictorSpec { inputs, skip: true, sigma: Sigma::SoftBounded, ..plain };
    Policy::untrained(&dims(), 11, networks).unwrap()
}

#[test]
fn what_networks_are_like_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    let policy = with_everything();
    policy.save(&path).unwrap();
    let opened = Policy::open(&path, &dims()).unwrap();
    assert_eq!(opened.networks(), policy.networks());
    assert_eq!(bits(&values(&opened)), bits(&values(&policy)));
    let words = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    let paper = r#"{\"held\":[],\"hidden\":5,\"inputs\":\"estimate\",\"name\":\"maro\",\"sigma\":\"exp\"}"#;
    assert!(words.contains(paper), "that of the paper stands as it always did: {words}");
    for word in [
        r#"\"inputs\":[\"estimate\",\"own-action\"]"#,
        r#"\"sigma\":\"soft-bounded\""#,
        r#"\"skip\":true"#,
        r#""actor_inputs":"[\"estimate\",\"delivered\",\"age\"]""#,
    ] {
        assert!(words.contains(word), "{word}: {words}");
    }
    let plain = String::from_utf8_lossy(&GOOD).into_owned();
    assert!(!plain.contains("actor_inputs") && !plain.contains("imputer"), "{plain}");
    let blind = Networks { actor_inputs: vec![Input::Estimate], ..policy.networks().clone() };
    let blind = Policy::untrained(&dims(), 11, blind).unwrap();
    assert_ne!(blind.fingerprint(), policy.fingerprint());
}

#[test]
fn inputs_that_there_are_not_are_refused_by_name() {
    let with = |inputs: &str| {
        let predictor =
            format!(r#"[{{"name":"maro","inputs":{inputs},"sigma":"exp","held":[],"hidden":5}}]"#);
        with_word("predictors", Some(predictor.leak()))
    };
    failed(
        &with(r#"["estimate","weather"]"#),
        "unknown variant `weather`, expected one of `estimate`, `egocentric`, `delivered`, `age`, `innovation`, `proximity`, `own-action`",
    );
    failed(&with(r#""weather""#), "unknown variant `weather`");
    failed(&with("7"), "expected `estimate` or a list of inputs");
    for out_of_order in [
        r#"[]"#,
        r#""own-action""#,
        r#"["own-action","estimate"]"#,
        r#"["estimate","estimate"]"#,
        r#"["estimate","egocentric"]"#,
        r#"["egocentric"]"#,
    ] {
        failed(&with(out_of_order), "predictor \"maro\" sees `estimate` first");
    }
    failed(
        &with(r#"["estimate","proximity"]"#),
        "and toy does not tell where two agents or more are; leave it out",
    );
    failed(&with_word("actor_inputs", Some("[\"estimate\",\"weather\"]")), "unknown variant `weather`");
    let out_of_order = with_word("actor_inputs", Some("[\"estimate\",\"age\",\"delivered\"]"));
    failed(&out_of_order, "the actors see `estimate` or `egocentric` first");
    let wider = with_word("actor_inputs", Some("[\"estimate\",\"age\"]"));
    failed(&wider, "actors.0.fc1.weight is [7, 8], expected [10, 8]");
    let bytes = changed(|header, _| {
        let predictors = header["__metadata__"]["predictors"].as_str().unwrap();
        let acting = predictors.replacen(r#""estimate""#, r#"["estimate","own-action"]"#, 1);
        header["__metadata__"]["predictors"] = json!(acting);
    });
    failed(&bytes, "predictors.maro.fc1.weight is [7, 5], expected [22, 5]");
}
