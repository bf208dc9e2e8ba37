"""The test kit for simulators: what each has to do, as checks that can be run one by one."""
