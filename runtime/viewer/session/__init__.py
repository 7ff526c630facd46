"""The interactive simulation, without any window: commands in, frames out."""
