# docker build -t relight .
# docker build -t relight:cuda --build-arg TORCH_INDEX=https://download.pytorch.org/whl/cu128 .
# docker run --rm -it -v "$PWD/results:/relight/results" relight run scale=smoke       (--gpus all for CUDA)
FROM python:3.11-slim-bookworm

# Where torch comes from: the index of its builds for CPUs, or for a version of CUDA.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu

ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 GIT_PYTHON_REFRESH=quiet
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /relight

# The system libraries that `make` looks for, too.
COPY workflow/scripts/system.py workflow/scripts/
RUN python workflow/scripts/system.py && rm -rf /var/lib/apt/lists/*

# The versions of constraints.txt, in layers that last until these change.
COPY constraints.txt ./
RUN pip install --index-url "$TORCH_INDEX" --extra-index-url https://pypi.org/simple \
    --constraint constraints.txt "torch==$(sed -n 's/^torch==\([^ ;]*\).*/\1/p' constraints.txt | head -n 1)"
COPY pyproject.toml README.md ./
COPY relight/__init__.py relight/
COPY conf conf
RUN pip install --constraint constraints.txt --editable .

# Everything else: the workflow runs from a clone, with its settings beside it.
COPY . .
RUN useradd --create-home --uid 1000 user && mkdir -p results .snakemake && chown -R 1000:1000 /relight
USER 1000
ENTRYPOINT ["relight"]
CMD ["--help"]
