"""The blocks of prefect-aws that a store may name, with the fields that Simyard reads, where it is not installed."""

from prefect.blocks.core import Block
from pydantic import BaseModel, Field, SecretStr


class ClientParameters(BaseModel):
    """Of a client of S3."""

    endpoint_url: str | None = None


class AwsCredentials(Block):
    """As prefect-aws 0.7 has it."""

    _block_type_name = "AWS Credentials"
    _block_type_slug = "aws-credentials"

    aws_access_key_id: str | None = None
    aws_secret_access_key: SecretStr | None = None
    aws_session_token: str | None = None
    profile_name: str | None = None
    region_name: str | None = None
    aws_client_parameters: ClientParameters = Field(default_factory=ClientParameters)
    assume_role_arn: str | None = None


class S3Bucket(Block):
    """As prefect-aws 0.7 has it."""

    _block_type_name = "S3 Bucket"
    _block_type_slug = "s3-bucket"

    bucket_name: str
    credentials: AwsCredentials = Field(default_factory=AwsCredentials)
    bucket_folder: str = ""
