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
         p ~ U(0, 1) of their own per episode. Dynamic: those redrawn every 5 steps.",
    ),
    (
        "return",
        "The sum of the team's rewards in an episode, undiscounted. Means are over all episodes of all policies of a \
         group.",
    ),
    (
        "95 % interval",
        "The bands and bars of figures, and what is in brackets: a bootstrap over episodes, the same resampled ones for all cells. It says \
         how sure we are about these policies, had other episodes been played, and nothing about policies from other \
         training runs; for that there is the standard deviation over policies.",
    ),
    (
        "standard deviation over policies",
        "The unbiased standard deviation of the policies' mean returns: how much the seed of training matters.",
    ),
    (
        "score",
        "The return on a scale on which 0 is what uniformly random actions bring in, and 1 what the same policies \
         bring in where everything is delivered.",
    ),
    (
        "difference",
        "The return of an episode minus that of the same episode with the baseline: the same policy, initial \
         state, and draws of actions and links. Positive is better than the baseline; the percentage is of the size \
         of the baseline's mean return. Bold where the interval leaves out zero and the difference does not round to it.",
    ),
    (
        "episodes that go better",
        "The probability of improvement: the share of episodes that go better than with the baseline, ties counting \
         half. At 50 % neither is better.",
    ),
    (
        "ratio of standard deviations",
        "The standard deviation over policies, divided by the baseline's: below 1, seeds matter less. Of a few policies \
         it is rough; of two it says nothing, and is left out here.",
    ),
    ("area", "The area under the curve over p, divided by the width of the levels: a mean over p."),
    (
        "p for 90 %",
        "The lowest p at which the score is still 0.9, by linear interpolation between levels; the lower, the more \
         loss is borne.",
    ),
    (
        "IQM",
        "The interquartile mean: of the middle half of the values, so that few extreme ones do not decide.",
    ),
    (
        "RMSE by age",
        "The root mean squared error of imputed values that were last received so many steps ago, over all \
         receivers, episodes and levels below 1, apart for each unit.",
    ),
    (
        "within the 50 % and the 95 % interval",
        "A learned predictor states how sure it is. The share of true values within the central 50 % and 95 % \
         intervals that it stated should be 50 % and 95 %; less means that it is surer than it may be. The mean \
         of the squared error in units of the stated standard deviation should be 1.",
    ),
];

/// Oracles, where there are any.
pub const ORACLE: (&str, &str) = (
    "+oracle:own, +oracle:others, +oracle:constants, +oracle:agent:K",
    "No imputer: the agents are told a part of the truth, and the imputer before the plus has the rest. The part is every \
     value about the agent itself, about all other agents, about no agent (landmarks, colours, messages), or about agent \
     K, whoever observes it. The score that an oracle wins back, as a share of the score that its imputer loses, is what \
     not knowing that part explains. Shares of parts need not add up to 100 %.",
);

/// Imputers, by their names.
pub const IMPUTERS: &[(&str, &str)] = &[
    (
        "value-aware",
        "An LSTM that predicts the next change of every observation, trained with more weight on what the policy is \
         moving towards.",
    ),
    ("maro", "The same network, trained to predict all that was replayed to it alike."),
    ("lambda0", "The same network, trained on what value-aware is trained on, but with equal weights."),
    ("hold", "What was received last."),
    ("velocity", "What was received last, moved on by the velocity that was received with it."),
    ("zero", "Zeros."),
];
