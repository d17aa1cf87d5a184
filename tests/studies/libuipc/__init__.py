"""The same press by libuipc, the engine that the paper runs on, beside ours."""
