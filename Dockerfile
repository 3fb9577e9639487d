# CPU only. Both README commands run in it:
#   docker build -t knotflow .
#   docker run --rm -v "$PWD/plans:/knotflow/plans" knotflow      # make run
#   docker run --rm knotflow make test
FROM python:3.12-slim

# git: a result names the commit it was made from.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends git make \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /knotflow

# PyTorch's own index has the build without CUDA, which saves gigabytes.
ENV PIP_NO_CACHE_DIR=1 \
    PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
RUN python -m venv .venv \
    && .venv/bin/pip install --index-url https://download.pytorch.org/whl/cpu "torch>=2.11,<2.14"

COPY . .
RUN make .venv/.installed

CMD ["make", "run"]
