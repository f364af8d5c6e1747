rule lights:
    input:
        cfg=settings("lights"),
        panoramas=files(PLAN.panoramas),
        veto=PLAN.cfg.lights.veto or [],
    output:
        lights=f"{OUT}/lights/lights.npz",
        table=f"{OUT}/lights/lights.csv",
        record=f"{OUT}/lights/chain.json",
    log:
        f"{OUT}/log/lights.log",
    benchmark:
        f"{OUT}/benchmark/lights/all.tsv"
    resources:
        mem_mb=4000,
    shell:
        command("lights")
        + "io.out={output.lights:q} io.record={output.record:q}"
        + LOGGED
