use super::*;
use crate::base::error::Error;
use crate::nn::weights::Storage;

#[test]
fn a_saved_policy_opens_as_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    for actor in [ActorKind::Mlp, ActorKind::Gru] {
        for sharing in [Sharing::Separate, Sharing::Shared] {
            let policy = policy(actor, sharing);
            policy.save(&path).unwrap();
            let opened = Policy::open(&path, &dims()).unwrap();
            assert_eq!(bits(&values(&opened)), bits(&values(&policy)));
            assert_eq!((opened.meta(), opened.networks()), (policy.meta(), policy.networks()));

            let bytes = std::fs::read(&path).unwrap();
            opened.save(&path).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes, "the same policy is the same file");
            assert_eq!(bits(&values(&opened)), bits(&values(&policy)), "what was mapped is still there");
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside the file");
}

#[test]
fn an_opened_policy_is_mapped_and_its_matrices_lie_on_cache_lines() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    let dims = Dims { joint: 17, ..dims() };
    Policy::untrained(&dims, 1, Networks::paper(ActorKind::Gru)).unwrap().save(&path).unwrap();
    let policy = Policy::open(&path, &dims).unwrap();
    for (spec, tensor) in policy.tensors() {
        assert!(matches!(*tensor.storage, Storage::Mapped { .. }));
        let on_a_line = tensor.values().as_ptr().addr() % 64 == 0;
        assert!(on_a_line || spec.n_values() % 16 != 0, "{}", spec.name);
    }
}

#[test]
fn half_precision_is_half_the_size_and_rounds_once() {
    let folder = tempfile::tempdir().unwrap();
    let [full, half] = ["full", "half"].map(|name| folder.path().join(name));
    let policy = Policy::untrained(&dims(), 3, Networks::paper(ActorKind::Gru)).unwrap();
    policy.save(&full).unwrap();
    policy.save_half(&half).unwrap();
    let [full, bytes] = [&full, &half].map(|path| std::fs::read(path).unwrap());
    assert!(bytes.len() < full.len() * 52 / 100, "{} of {}", bytes.len(), full.len());
    let opened = Policy::open(&half, &dims()).unwrap();
    assert!(opened.tensors().all(|(_, tensor)| matches!(*tensor.storage, Storage::Mapped { .. })));
    for (value, kept) in values(&policy).iter().zip(values(&opened)) {
        // f16 has 11 significant bits, and steps of 2^-24 below 2^-14.
        assert!((value - kept).abs() <= (value.abs() / 2048.0).max(2f32.powi(-25)), "{value} became {kept}");
    }
    opened.save_half(&half).unwrap();
    assert_eq!(std::fs::read(&half).unwrap(), bytes, "what is rounded once stays");
    let embedded = Policy::from_static(bytes.leak(), &dims()).unwrap();
    assert_eq!(bits(&values(&embedded)), bits(&values(&opened)));

    let mut large = values(&policy);
    large[7] = 1e5;
    let error = policy.with_values(&large).unwrap().save_half(&half).unwrap_err().to_string();
    assert!(error.contains("actors.0.fc1.weight holds 100000"), "{error}");
}

#[test]
fn embedded_bytes_make_a_policy_wherever_they_lie() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    let policy = policy(ActorKind::Gru, Sharing::Shared);
    policy.save(&path).unwrap();
    for offset in [0, 1, 4] {
        let mut bytes = vec![0; offset];
        bytes.extend(std::fs::read(&path).unwrap());
        let bytes: &'static [u8] = bytes.leak();
        let embedded = Policy::from_static(&bytes[offset..], &dims()).unwrap();
        assert_eq!(bits(&values(&embedded)), bits(&values(&policy)));
        let copied = embedded.tensors().any(|(_, tensor)| !matches!(*tensor.storage, Storage::Static(_)));
        assert_eq!(copied, offset == 1);
    }
}

#[test]
fn a_policy_file_describes_itself_without_the_task() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    let policy = policy(ActorKind::Gru, Sharing::Separate);
    policy.save(&path).unwrap();
    let file = PolicyFile::read(&path).unwrap();
    assert_eq!((&file.meta, &file.networks), (policy.meta(), policy.networks()));
    assert_eq!(file.tensors.iter().map(|tensor| tensor.n_values()).sum::<usize>(), policy.n_values());
    assert_eq!(file.tensors.len(), policy.tensors().count());
    let first = file.tensors.iter().find(|tensor| tensor.name == "actors.0.fc1.weight").unwrap();
    assert_eq!(first.shape, [7, 8]);
}

#[test]
fn untrained_weights_follow_from_the_seed() {
    let networks = || Networks::paper(ActorKind::Gru);
    let once = Policy::untrained(&dims(), 5, networks()).unwrap();
    let again = Policy::untrained(&dims(), 5, networks()).unwrap();
    let other = Policy::untrained(&dims(), 6, networks()).unwrap();
    assert_eq!(bits(&values(&once)), bits(&values(&again)));
    assert_ne!(bits(&values(&once)), bits(&values(&other)));
    for (spec, tensor) in once.tensors() {
        let largest = tensor.values().iter().fold(0.0f64, |largest, &value| largest.max(value.abs() as f64));
        assert!(largest <= spec.bound && largest > 0.5 * spec.bound, "{}", spec.name);
    }
    // The bounds are PyTorch's: from the inputs of a linear layer, from the hidden size of a cell.
    let bound = |name: &str| once.tensors().find(|(spec, _)| spec.name == name).unwrap().0.bound;
    assert_eq!(bound("actors.0.fc1.bias"), 1.0 / 7f64.sqrt());
    assert_eq!(bound("actors.2.gru.weight_ih"), 1.0 / 16.0);
    assert_eq!(bound("predictors.value-aware.lstm.bias_hh"), 1.0 / 128f64.sqrt());
}

#[test]
fn no_network_depends_on_which_others_there_are() {
    let all = Policy::untrained(&dims(), 5, networks(ActorKind::Mlp, Sharing::Separate)).unwrap();
    let specs = &all.networks().predictors[1..];
    let one = Networks { predictors: specs.to_vec(), ..networks(ActorKind::Mlp, Sharing::Separate) };
    let one = Policy::untrained(&Dims { n_agents: 2, ..dims() }, 5, one).unwrap();
    for (spec, tensor) in one.tensors() {
        let (_, same) = all.tensors().find(|(other, _)| other.name == spec.name).unwrap();
        assert_eq!(bits(tensor.values()), bits(same.values()), "{}", spec.name);
    }
    // Agents start differently, predictors alike.
    let weights = |name: &str| bits(all.tensors().find(|(spec, _)| spec.name == name).unwrap().1.values());
    assert_ne!(weights("actors.0.fc2.weight"), weights("actors.1.fc2.weight"));
    let alike = |name: &str| f32::from_bits(weights(name)[0]);
    let (maro, value_aware) =
        (alike("predictors.maro.fc1.weight"), alike("predictors.value-aware.fc1.weight"));
    assert_eq!(maro, value_aware);
}

#[test]
fn new_values_are_taken_in_order_and_checked() {
    let policy = policy(ActorKind::Mlp, Sharing::Separate);
    let mut fresh = numbers(3, policy.n_values());
    let renewed = policy.with_values(&fresh).unwrap();
    assert_eq!(bits(&values(&renewed)), bits(&fresh));
    let (first, weight) = renewed.tensors().next().unwrap();
    assert_eq!((&first.name[..], weight.values()), ("actors.0.fc1.weight", &fresh[..56]));

    let error = policy.with_values(&fresh[1..]).unwrap_err().to_string();
    assert!(error.contains(&format!("got {} weights, expected {}", fresh.len() - 1, fresh.len())), "{error}");
    fresh[60] = f32::INFINITY;
    let error = policy.with_values(&fresh).unwrap_err().to_string();
    assert!(error.contains("actors.0.fc1.bias holds inf at 4"), "{error}");
}

#[test]
fn predictors_are_found_by_name() {
    let policy = policy(ActorKind::Mlp, Sharing::Separate);
    assert_eq!(policy.predictor_names().collect::<Vec<_>>(), ["maro", "value-aware"]);
    assert_eq!(policy.predictor("maro").unwrap().spec().hidden, 5);
    assert!(policy.predictor("other").is_none());
}

#[test]
fn impossible_networks_are_refused() {
    let good = || networks(ActorKind::Mlp, Sharing::Separate);
    let mut cases = vec![Networks { hidden: 0, ..good() }, Networks { hidden: usize::MAX, ..good() }];
    let with = |change: &dyn Fn(&mut PredictorSpec)| {
        let mut networks = good();
        change(&mut networks.predictors[1]);
        networks
    };
    cases.push(with(&|predictor| predictor.name = "maro".to_string()));
    cases.push(with(&|predictor| predictor.name = "a.b".to_string()));
    cases.push(with(&|predictor| predictor.name = String::new()));
    cases.push(with(&|predictor| predictor.hidden = 0));
    cases.push(with(&|predictor| predictor.held = vec![6]));
    for networks in cases {
        let error = Policy::untrained(&dims(), 1, networks.clone()).unwrap_err();
        assert!(matches!(error, Error::Usage(_)), "{networks:?}: {error}");
    }
}
