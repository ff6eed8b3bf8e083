"""The flows that join the capabilities, and the command line. Nobody else imports it."""

import os

from tasks.server.process import SERVER_ENVIRONMENT

# Here because Prefect reads its settings when it is imported, which the flows do next: also a plain Python call on a
# cold machine must get a server that is given time to start, and no telemetry (docs/reference/prefect.md, section 2).
for _name, _value in SERVER_ENVIRONMENT.items():
    os.environ.setdefault(_name, _value)
