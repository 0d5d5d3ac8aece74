//! `lasray synth`: writes a town that does not exist.
