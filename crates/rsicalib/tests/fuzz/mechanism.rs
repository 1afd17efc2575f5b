//! Mechanisms as TOML.

use rsicalib::design::identifiability::{Counting, identifiable};
use rsicalib::mechanism::Mechanism;

use crate::{cases, damaged};

const TEXTS: [&str; 3] = [
    include_str!("../../../../examples/two_arms.toml"),
    include_str!("../../../../examples/draw_wire.toml"),
    include_str!("../../../../examples/ball_bar.toml"),
];

#[test]
fn a_damaged_mechanism_is_refused_with_a_reason_or_written_as_it_is_read() {
    let own = Mechanism::rsi().to_toml();
    cases(|drawn| {
        let text = *drawn.choose(&[&own, TEXTS[0], TEXTS[1], TEXTS[2]])?;
        let text = damaged(text, drawn)?;
        match Mechanism::from_toml(&text) {
            Err(error) => assert!(error.to_string().len() > 10, "{error} of {text}"),
            Ok(read) => {
                let again = Mechanism::from_toml(&read.to_toml());
                assert_eq!(again.as_ref(), Ok(&read), "{text}");
                // What a mechanism can be identified by has an answer, or is refused: some of them,
                // since the count takes longer than ten of these texts.
                if drawn.ratio(1, 8)? {
                    let _ = identifiable(&read, Counting::Complete, 0);
                }
            }
        }
        Ok(())
    });
}
