//! Whatever the bytes, the readers answer: with a plan or with faults.

use beampose_plan::{check, read_plan, read_rig};
use proptest::prelude::*;

const PLAN: &str = include_str!("../../../experiments/plans/translation-test.yaml");
const RIG: &str = include_str!("../../../experiments/rigs/simulated.yaml");

fn show(bytes: &[u8]) {
    if let Err(faults) = read_plan("p.yaml", bytes) {
        assert!(!faults.is_empty() && !faults.to_string().is_empty());
    }
    if let Err(faults) = read_rig("r.yaml", bytes) {
        assert!(!faults.is_empty() && !faults.to_string().is_empty());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_make_a_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        show(&bytes);
    }

    #[test]
    fn no_yaml_like_text_makes_a_reader_panic(
        text in r"([a-z&*!|>%@`'\x22#{}\[\],:?$ \n\t-]|[0-9]|- |: |\n  |é|mm|laser){0,120}",
    ) {
        show(text.as_bytes());
    }

    #[test]
    fn no_change_of_the_default_files_makes_them_panic(
        at in 0usize..8_000,
        length in 0usize..12,
        new in "([a-z0-9 :$-]|\n|[\\[\\]{}&*\"]){0,8}",
    ) {
        let change = |text: &str| {
            let mut bytes = text.as_bytes().to_vec();
            let from = at % bytes.len();
            let to = (from + length).min(bytes.len());
            bytes.splice(from..to, new.bytes());
            bytes
        };
        let (plan, rig) = (read_plan("p", &change(PLAN)), read_rig("r", &change(RIG)));
        if let (Ok(plan), Ok(rig)) = (plan, rig) {
            let _ = check(&plan, &rig);
        }
    }
}
