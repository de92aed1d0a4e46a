//! What a policy file says of where it comes from.

/// Where a policy comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Meta {
    /// The task it is for, by id.
    pub task: String,
    /// What trained it, such as `mappo`; `none` if nothing did.
    pub algorithm: String,
    /// How many environment steps it was trained for.
    pub steps: u64,
    /// The seed of the run that made it.
    pub seed: u64,
    /// The program that wrote it, with its version.
    pub program: String,
    /// Anything else that a reader should know.
    pub origin: String,
    /// What completed the estimates that its actors learned from, by name, if it says so: those that see what arrived have
    /// learned how far to trust that.
    pub imputer: Option<String>,
}

impl Meta {
    /// The algorithm of a file that holds an imputer, fitted to the play of a team from elsewhere, and no actors to speak of.
    pub const IMPUTER: &str = "fit-imputer";

    /// For a policy that this program makes for `task` in a run with `seed`, before any training.
    pub fn new(task: &str, seed: u64) -> Meta {
        Meta {
            task: task.to_string(),
            algorithm: "none".to_string(),
            steps: 0,
            seed,
            program: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_string(),
            origin: "untrained".to_string(),
            imputer: None,
        }
    }
}
