//! What the statistics of a report mean, in its own words. `docs/metrics.md` has the formulas.

/// Statistics.
pub const STATISTICS: &[(&str, &str)] = &[
    (
        "p",
        "The probability that a link delivers: every observation that one agent sends another at a step arrives with \
         probability p, independently of all others, and is lost with 1 - p.",
    ),
    (
        "uniform, asymmetric, dynamic",
        "Links without one fixed p. Uniform: one p ~ U(0, 1) per episode. Asymmetric: for each sender and receiver a \
         p ~ U(0, 1) of its own per episode. Dynamic: the same, redrawn every 5 steps.",
    ),
    (
        "return",
        "The sum of the team's rewards in an episode, undiscounted. Means are over all episodes of all policies of a \
         group.",
    ),
    (
        "95 % interval",
        "The bands and bars of figures, and the numbers in brackets: a bootstrap over episodes, with the same resamples for all \
         cells. It says how much the result for these policies would vary with other episodes, and nothing about policies \
         from other training runs; for that there is the standard deviation over policies.",
    ),
    (
        "standard deviation over policies",
        "The unbiased standard deviation of the policies' mean returns: how much the training seed matters.",
    ),
    (
        "score",
        "The return on a scale where 0 is the return of uniformly random actions, and 1 that of the same policies \
         when everything is delivered.",
    ),
    (
        "difference",
        "The return of an episode minus that of the same episode with the baseline: the same policy, initial \
         state, and draws of actions and links. Positive is better than the baseline; the percentage is relative to \
         the baseline's mean return. Bold if the interval excludes zero and the difference does not round to zero.",
    ),
    (
        "episodes that go better",
        "The probability of improvement: the share of episodes that go better than with the baseline, ties counting \
         half. At 50 % neither is better.",
    ),
    (
        "ratio of standard deviations",
        "The standard deviation over policies, divided by the baseline's: below 1, seeds matter less. With few policies \
         it is rough; with two it means nothing, and is left out here.",
    ),
    ("area", "The area under the curve over p, divided by the width of the levels: a mean over p."),
    (
        "p for 90 %",
        "The lowest p at which the score is still 0.9, by linear interpolation between levels; the lower, the more \
         loss the team can bear.",
    ),
    (
        "IQM",
        "The interquartile mean: the mean of the middle half of the values, so a few extreme ones do not matter.",
    ),
    (
        "RMSE by age",
        "The root mean squared error of imputed values by the number of steps since they were last received, over all \
         receivers, episodes and levels below 1, separately for each unit.",
    ),
    (
        "within the 50 % and the 95 % interval",
        "A learned predictor states how sure it is. The share of true values within the central 50 % and 95 % \
         intervals that it stated should be 50 % and 95 %; less means that it is overconfident. The mean \
         of the squared error in units of the stated standard deviation should be 1.",
    ),
];

/// Oracles, where there are any.
pub const ORACLE: (&str, &str) = (
    "+oracle:own, +oracle:others, +oracle:constants, +oracle:agent:K",
    "Not an imputer: the agents are told a part of the truth, and the imputer before the plus imputes the rest. The part is every \
     value about the agent itself, about all other agents, about no agent (landmarks, colours, messages), or about agent \
     K, whoever observes it. The score that an oracle wins back, as a share of the score that its imputer loses, is the loss \
     explained by not knowing that part. Shares of parts need not add up to 100 %, and one may exceed it.",
);

/// Imputers, by their names.
pub const IMPUTERS: &[(&str, &str)] = &[
    (
        "value-aware",
        "An LSTM that predicts the next change of every observation, trained with more weight on transitions with a high \
         advantage.",
    ),
    ("maro", "The same network, trained on replayed episodes with equal weights."),
    ("lambda0", "The same network, trained on the episodes of value-aware, but with equal weights."),
    (
        "acting",
        "An LSTM that also sees what its agent does and who is near whom, trained afterwards in closed loop.",
    ),
    ("hold", "The last value received."),
    ("velocity", "The last value received, extrapolated by the velocity received with it."),
    ("zero", "Zeros."),
];
