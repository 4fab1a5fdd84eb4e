//! graintrain
