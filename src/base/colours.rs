//! What colours stand for in pictures of a swarm, each on light and on dark paper, as in `page.css` and `page.js` of a replay.

/// An observation that arrives.
pub const ARRIVES: [u32; 2] = [0x1a_7f4b, 0x4a_c97e];

/// One that comes after the deadline.
pub const LATE: [u32; 2] = [0xb2_6a00, 0xe3_b341];

/// One that the links lose.
pub const LOST: [u32; 2] = [0xc0_392b, 0xff_7b72];

/// An agent.
pub fn agent(agent: usize) -> [u32; 2] {
    const AGENTS: [[u32; 2]; 7] = [
        [0x00_72b2, 0x56_b4e9],
        [0xd5_5e00, 0xe6_9f00],
        [0x00_7a59, 0x2f_c99c],
        [0xa0_447c, 0xcc_79a7],
        [0x44_4444, 0xf0_e442],
        [0x6b_7580, 0x9a_a4ae],
        [0x3a_7fae, 0xe0_7a5f],
    ];
    AGENTS[agent % AGENTS.len()]
}
