"""Reports: tables and figures of stored Findings and Records, without any computation of
dynamics.
"""
