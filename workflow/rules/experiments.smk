# Experiments that are not tables of trainings. Their rows are the networks that they use.
if "light_transfer" in PLAN.experiments:

    rule light_transfer:
        "Lights each person by the light that is inferred of another."
        input:
            networks=PLAN.networks("light_transfer").values(),
            packed=PACKED,
            split=SPLIT,
            lights=LIGHTS,
        output:
            scores=f"{OUT}/light_transfer/scores.csv",
            plate=f"{OUT}/light_transfer/plate.png",
        log:
            f"{OUT}/log/light_transfer.log",
        benchmark:
            f"{OUT}/benchmark/light_transfer/all.tsv"
        resources:
            mem_mb=8000,
            gpu=PLAN.gpus,
        params:
            trainings=list(PLAN.networks("light_transfer")),
            rows=PLAN.first_trainings("light_transfer"),
            code=code_hash("light_transfer"),
        script:
            "../scripts/light_transfer.py"
